"""The page docs/validation.md, from the results of the commands that it names.

make validation        runs them all into out/validation (half an hour on two cores), then
python docs/validation.py out/validation        writes docs/validation.md
"""

import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

DOCS = Path(__file__).parent

HEAD = """# Validation

What is claimed of whiskjax, the figure, the band in which it should lie, and who sets the band. Written by
`python docs/validation.py out/validation` from the results of the commands below; `make validation` runs them all. A figure
outside its band is bold and stands here all the same.

{verdict}
"""
STUDIES = {
    "whiskbroom": ("Whiskbroom scanner, Jin et al. (2024)", "whiskjax reproduce whiskbroom --out out/validation/whiskbroom"),
    "three_line": ("Three-line camera, Wang et al. (2018)", "whiskjax reproduce three-line --out out/validation/three_line"),
    "location": ("Target location, Liu et al. (2019)", "whiskjax reproduce location --out out/validation/location"),
}
STUDY_SOURCE = (
    "The bands are the spread over seeds of an independent implementation of the same flights in another language, and the "
    "paper's own figure where it prints one. Everything else that the study prints: [{page}.md]({page}.md)."
)
REAL_SOURCE = (
    "Recorded by others (IGN, MISB sample flights, LASP, DBAT's Strasbourg block); the bands follow from their published "
    "accuracies and from independent evaluations in numpy. The data are not part of the repository: `$WHISKJAX_DATA` says where "
    "they are."
)
PEER_SOURCE = (
    "The same numbers by programs that know nothing of whiskjax; the band is the printed digits or the peer's own tolerance."
)


class Claim(NamedTuple):
    """One figure: what is claimed, its unit, its band, the value, whether it lies inside, and who sets the band."""

    what: str
    unit: str
    band: str
    value: float | None
    inside: bool
    source: str


def band(low: float | None, high: float | None) -> str:
    """A band in words."""
    if low is not None and high is not None:
        return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
    return f"≤ {high:.4g}" if low is None else f"≥ {low:.4g}"


def of_whiskbroom(summary: dict) -> Iterator[Claim]:
    """Each figure with a band once; Table 6 before Table 2, which repeats it."""
    from whiskjax.papers.whiskbroom.summary import label

    seen = {}
    for f in summary["figures"]:
        if f["is_inside"] is not None:
            seen[label(f)] = Claim(
                f"Table {f['table']}, {label(f)}",
                "px",
                band(f["band_low"], f["band_high"]),
                f["median"],
                f["is_inside"],
                f"paper {f['paper']:g}",
            )
    yield from seen.values()
    for row in summary["open_questions"]:
        if row["is_inside"] is not None:
            yield Claim(
                f"{row['section']}: {row['what']}",
                row["unit"],
                band(row["low"], row["high"]),
                row["reached"],
                row["is_inside"],
                "set before",
            )


def of_location(summary: dict) -> Iterator[Claim]:
    """Each figure with a band."""
    for f in summary["figures"]:
        if f["is_inside"] is not None:
            source = f"paper {f['paper']}" if f.get("paper") else "theory or simulation"
            yield Claim(
                f"{f['section']}, {f['what']}", f["unit"], band(f["low"], f["high"]), f["reached"], f["is_inside"], source
            )


def of_three_line(summary: dict) -> Iterator[Claim]:
    """Each row and figure with a band."""
    for r in summary["rows"]:
        if r["is_inside"] is not None:
            what = f"Table {r['table']}, {r['trial']}, {r['axis']}: RMSE"
            yield Claim(
                what, "m", band(r["low_m"], r["high_m"]), r["nominal_rmse_m"], r["is_inside"], f"paper {r['paper_rmse_m']:g}"
            )
    yield from of_location(summary)


READERS = {"whiskbroom": of_whiskbroom, "three_line": of_three_line, "location": of_location}


def of_figures(path: Path, source: str) -> Iterator[Claim]:
    """The figures with a band that `python -m tests.real` and `python -m tests.peers` keep."""
    for f in json.loads(path.read_text("utf-8")):
        if f["high"] is not None:
            limit = band(f["low"], f["high"])
            yield Claim(f"{f['set']}: {f['what']}", f["unit"], limit, f["value"], f["is_inside"], f.get("source") or source)


def number(value: float | None) -> str:
    """Three digits, never in a form that only programs read."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.3g}"


def table(claims: Sequence[Claim]) -> str:
    """As Markdown."""
    lines = ["| claim | unit | figure | band | band set by |", "|---|---|---:|---:|---|"]
    for c in claims:
        value = number(c.value) if c.inside else f"**{number(c.value)}**"
        cells = c.what.replace("|", "\\|"), "" if c.unit == "1" else c.unit, value, c.band, c.source
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def section(title: str, command: str, remark: str, claims: Sequence[Claim]) -> str:
    """A title, the command, how many lie inside, and the table."""
    inside = sum(c.inside for c in claims)
    return "\n\n".join([f"## {title}", f"`{command}`", f"{inside} of {len(claims)} figures lie inside. {remark}", table(claims)])


def page(results: Path) -> str:
    """The whole page from a folder of results."""
    parts, claims = [], []
    for name, (title, command) in STUDIES.items():
        found = list(READERS[name](json.loads((results / name / "results.json").read_text("utf-8"))))
        parts.append(section(title, command, STUDY_SOURCE.format(page=name), found))
        claims += found
    for name, title, command, remark in (
        ("real", "Real flights", "python -m tests.real --out out/validation/real", REAL_SOURCE),
        ("peers", "Independent programs", "python -m tests.peers --out out/validation/peers", PEER_SOURCE),
    ):
        found = list(of_figures(results / name / "figures.json", "the data's publisher"))
        parts.append(section(title, command, remark, found))
        claims += found
    outside = [c for c in claims if not c.inside]
    told = "; ".join(f"{c.what} ({number(c.value)}, band {c.band})" for c in outside)
    verdict = f"**{len(claims) - len(outside)} of {len(claims)} figures lie inside their bands.** Outside: {told or 'none'}."
    return "\n\n".join([HEAD.format(verdict=verdict).rstrip(), *parts]) + "\n"


if __name__ == "__main__":
    (DOCS / "validation.md").write_text(page(Path(sys.argv[1])), "utf-8")
