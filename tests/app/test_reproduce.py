"""`whiskjax reproduce whiskbroom`: every figure of the paper beside the simulation's, and an exit code that means it."""

import csv
import dataclasses
import json

import numpy as np
import pytest

import whiskjax as wj
from tests.app.said import progress
from whiskjax.chain.by import By
from whiskjax.flights import haian
from whiskjax.papers.whiskbroom import findings
from whiskjax.papers.whiskbroom import printed as paper

pytestmark = pytest.mark.slow

SEEDS = (3, 4, 5, 6)
FEW = ("--seeds", len(SEEDS), "--first-seed", SEEDS[0], "--no-open-questions")
WRITTEN = {
    "report.html",
    "results.json",
    "seeds.csv",
    *(f"table_{number}.csv" for number in range(1, 8)),
    *(f"figure_{number}.png" for number in range(3, 8)),
}


@pytest.fixture(scope="module")
def reproduced(whiskjax, tmp_path_factory):
    """(the command's result, the folder it wrote); not to be changed."""
    out = tmp_path_factory.mktemp("reproduced") / "whiskbroom"
    return whiskjax("reproduce", "whiskbroom", "--out", out, *FEW), out


@pytest.fixture(scope="module")
def results(reproduced):
    return json.loads((reproduced[1] / "results.json").read_text(encoding="utf-8"))


def of_seed(out, seed):
    with (out / "seeds.csv").open(encoding="utf-8", newline="") as file:
        return {
            (row["image"], row["parameters"], row["points"], row["statistic"], row["axis"]): float(row["value_px"])
            for row in csv.DictReader(file)
            if int(row["seed"]) == seed
        }


def statistics(residual):
    return {
        (name, axis): float(value[a])
        for name, value in (("mean", residual.mean(axis=0)), ("std", residual.std(axis=0, ddof=1)))
        for a, axis in enumerate("xy")
    }


def exchanged(sensor, left, right):
    """The sensor with the R_pos of one swing taken from another; `left`, `right`: the names of the options they get."""
    links = dict(zip(sensor.names, sensor.links, strict=True))
    links["platform"] = By("swing", {"left": sensor["platform"][left], "right": sensor["platform"][right]})
    return wj.Sensor(links, sensor.camera)


def test_writes_everything(reproduced):
    result, out = reproduced
    progress(result.stderr)
    assert {path.name for path in out.iterdir()} == WRITTEN
    assert all((out / f"figure_{number}.png").read_bytes().startswith(b"\x89PNG") for number in range(3, 8))


def test_one_seed_by_an_independent_loop(reproduced):
    """`calibrate` twice, R_pos exchanged by hand, means and standard deviations by numpy: the same to 1e-5 px."""
    seed = SEEDS[1]
    flight = haian.simulate(seed, drift=True)
    observations = flight.observations()
    image, role = np.asarray(observations.images), np.asarray(flight.points.roles)[flight.measurements.point]
    only_left = dataclasses.replace(observations, is_control=(image == "L1") & (role == "control"))
    shared = [x for x in flight.unknowns if not x.name.endswith("_right")]
    left = wj.calibrate(flight.sensor, only_left, shared).sensor
    both = wj.calibrate(flight.sensor, observations, flight.unknowns).sensor
    sensors = {
        "none": flight.sensor,
        "A": exchanged(left, "left", "left"),
        "CL": exchanged(both, "left", "left"),
        "CR": exchanged(both, "right", "right"),
    }
    residual = {
        name: observations.pixel_px - np.asarray(wj.project(sensor, observations.shot, observations.point_m).pixel_px)
        for name, sensor in sensors.items()
    }
    reached = of_seed(reproduced[1], seed)
    columns = {column for printed in paper.TABLES for column in printed.columns}
    assert len(reached) == 4 * len(columns)
    for column in columns:
        here = (image == column.image) & ((column.points == "all") | (role == column.points))
        for (statistic, axis), value in statistics(residual[column.parameters][here]).items():
            assert reached[(*column, statistic, axis)] == pytest.approx(value, abs=1e-5)


def test_medians_and_ranges_are_those_of_the_seeds(reproduced, results):
    each = [of_seed(reproduced[1], seed) for seed in SEEDS]
    assert len(results["figures"]) == 8 + 8 + 12 + 12 + 48
    for f in results["figures"]:
        key = (f["image"], f["parameters"], f["points"], f["statistic"], f["axis"])
        values = [abs(seed[key]) if f["is_absolute"] else seed[key] for seed in each]
        np.testing.assert_allclose(
            [f["low_5"], f["median"], f["high_95"]], np.percentile(values, [5, 50, 95]), rtol=0, atol=1e-12
        )


def test_parameters_are_those_that_the_data_determine(results):
    """scenarios.md: shares of the data, the sigma of omega left - right, and estimates within four of their sigmas."""
    rows = {row["name"]: row for row in results["parameters"]["4"]}
    for name, share in {
        "phi_pos_left": 0.83,
        "w_sen": 0.76,
        "v_gps": 0.29,
        "v_sen": 0.10,
        "u_gps": 0.05,
        "omega_sen": 0.0,
    }.items():
        assert rows[name]["data_share"] == pytest.approx(share, abs=0.03)
    for name in ("omega_pos_left", "kappa_pos_right", "phi_sen", "w_gps", "kappa_sen"):
        assert round(rows[name]["data_share"], 2) >= 0.96
    assert rows["omega_pos left - right"]["sigma"] == pytest.approx(0.0020, abs=1e-4)  # by the points of one seed
    combined = [row for number in "14" for row in results["parameters"][number] if row["is_combination"]]
    assert len(combined) == 1 + 5
    for row in combined:
        assert abs(row["representative"] - row["truth"]) < 4 * row["sigma"]


def test_prints_every_table_and_the_verdict(reproduced, results):
    result, out = reproduced
    for number in range(1, 8):
        assert f"Table {number}." in result.stdout
    verdict = results["verdict"]
    assert verdict["bands"] == 21
    assert f"{verdict['bands_inside']} of 21 figures with a band are inside it." in result.stdout.splitlines()
    assert result.exit_code == (0 if verdict["is_inside"] else 3)
    page = (out / "report.html").read_text(encoding="utf-8")
    for finding in findings.findings(results):
        assert f"<h3>{finding.title}</h3>" in page.replace("&#39;", "'")
    for printed in paper.TABLES:
        assert f"Table {printed.number}. {printed.title} (px)" in page


def test_correlations_fall_for_phi_and_stay_for_omega(results):
    """With the swing the correlation falls for phi_pos; the omega pair never separates."""
    pairs = {p["first"]: p["correlation"] for p in results["correlation_by_scan"]["pairs"]}
    assert abs(pairs["phi_pos"][-1]) < 0.5 * abs(pairs["phi_pos"][0])
    assert min(abs(c) for c in pairs["omega_pos"][2:]) > 0.998
    assert min(abs(c) for c in pairs["u_gps"]) > 0.99


def test_ends_in_three_when_a_band_is_left(whiskjax, reproduced, monkeypatch, tmp_path):
    column = paper.Column("L2", "CR", "all")
    bands = {**paper.BANDS, (column, "mean", "y"): paper.Band(-7.0, -6.0)}
    monkeypatch.setattr("whiskjax.papers.whiskbroom.summary.BANDS", bands)
    out = tmp_path / "out"
    result = whiskjax("reproduce", "whiskbroom", "--out", out, "--seeds", 1, "--first-seed", SEEDS[0], "--no-open-questions")
    assert result.exit_code == 3
    assert "outside: L2 CR, mean y" in result.stdout
    verdict = json.loads((out / "results.json").read_text(encoding="utf-8"))["verdict"]
    assert not verdict["is_inside"] and "L2 CR, mean y" in verdict["outside"]
    assert "outside its bands" in (out / "report.html").read_text(encoding="utf-8")


def test_a_failure_leaves_nothing(whiskjax, monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("whiskjax.papers.page.make_report", full)
    result = whiskjax("reproduce", "whiskbroom", "--out", tmp_path / "new" / "out", "--seeds", 1, "--no-open-questions")
    assert result.exit_code == 1 and "No space left" in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [[], ["whiskbroom"], ["whiskbroom", "--seeds", "0"], ["mars"]])
def test_wrong_usage_ends_in_two(whiskjax, words, tmp_path):
    out = ["--out", tmp_path / "out"] if "--seeds" in words else []
    assert whiskjax("reproduce", *words, *out).exit_code == 2
    assert not list(tmp_path.iterdir())
