"""What paper 000 says against itself, or leaves open, in words whose figures come from the summary.

The report and docs/whiskbroom.md take their text from here.
"""

from typing import NamedTuple

import numpy as np

from ...flights.haian_paper import TABLE_1, TABLE_4
from ..summary import Summary
from ..tables import fixed, percent


class Finding(NamedTuple):
    """A statement of the paper, and what its own figures and the simulation say of it."""

    title: str
    paper: str
    here: str


def agreement(summary: Summary) -> tuple[str, ...]:
    """Which agreement was tuned and which follows, in sentences."""
    noise = ", ".join(f"{image} {n['x']:g}/{n['y']:g}" for image, n in summary["simulation"]["noise_px"].items())
    free, hit = summary["verdict"]["without_band"], summary["verdict"]["without_band_paper_in_range"]
    return (
        f"Tuned to the paper are three things, marked T: the focal length ({summary['simulation']['focal_px']:g} px, from the "
        f"mean y before), the image noise ({noise} px in x/y, from the standard deviations after) and the drift of the IMU "
        "boresight of L3 and R3 (from their residuals with their own parameters). An agreement marked T was put in.",
        "Everything else follows from Table 4 of the paper, which is the truth of the simulation, from the geometry and from the "
        "model: that a swing's parameters carry over to other images of the same swing but leave about 9 px in y on the other "
        "one, that the spread in x grows there, and how far check points scatter. The priors are the scenario's; the paper does "
        "not print its weights.",
        f"Of {free} printed figures without a band, {hit} lie within the 5 % to 95 % range of the seeds; nine in ten would if "
        "the paper's flight were one more seed. Those that do not are means of control points after the calibration, which are "
        "zero by construction, and what the list below explains.",
    )


def findings(summary: Summary) -> tuple[Finding, ...]:
    """The contradictions and open places, in the order of the paper."""
    return (
        _swing(summary),
        _same_image(summary),
        _mean_x(summary),
        _spread_y(summary),
        Finding(
            "The “variance” is a standard deviation",
            "Sections 3.1 and 3.2 announce “mean and variance” of the residuals; the tables' headings say standard deviation.",
            "The values are standard deviations in pixels: as variances they would put the image noise at 1 to 2 px and the "
            "changes from swing to swing, which follow from Table 4, would not fit. All tables here are standard deviations "
            "(n − 1).",
        ),
        _half_degree(),
        _single(summary),
        _subpixel(summary),
        Finding(
            "The conclusion names the wrong images",
            "“The parameters computed from two pairs of left and right images (L2, R2 and L3, R3) can be applied to other images.”",
            "Section 3.2 and the caption of Table 4 say that they come from L1 and R1, and Table 7 could not look as it does "
            "otherwise: an image that takes part keeps no mean of its own, but L3 and R3 have −1.6 and −2.0 px in x. Here L1 and "
            "R1 are calibrated, and L2, R2, L3 and R3 take no part.",
        ),
        _order(summary),
    )


def _figure(summary: Summary, table: int, image: str, parameters: str, statistic: str, axis: str, points: str = "") -> Summary:
    (row,) = (
        f
        for f in summary["figures"]
        if (f["table"], f["image"], f["parameters"], f["statistic"], f["axis"]) == (table, image, parameters, statistic, axis)
        and points in ("", f["points"])
    )
    return row


def _swing(summary: Summary) -> Finding:
    scans = summary["correlation_by_scan"]["scan_deg"]
    pair = {p["first"]: p["correlation"] for p in summary["correlation_by_scan"]["pairs"]}
    return Finding(
        "Does the correlation grow with the swing?",
        "The abstract and the introduction say that the mountings of camera and POS become more correlated at large scan angles; "
        "section 2.1 says that their correlation falls.",
        f"It depends on the parameter. From one left image whose points reach to ±{scans[0]}° and to ±{scans[-1]}°, without "
        f"priors: phi_pos with phi_sen {fixed(pair['phi_pos'][0], 2)} and {fixed(pair['phi_pos'][-1], 2)}, kappa_pos with "
        f"kappa_sen {fixed(pair['kappa_pos'][0], 2)} and {fixed(pair['kappa_pos'][-1], 2)}: these come apart. omega_pos with "
        f"omega_sen {fixed(pair['omega_pos'][0], 3)} and {fixed(pair['omega_pos'][-1], 5)}: both turn about the scan axis, and "
        f"no swing separates them. The lever arms u stay at {fixed(pair['u_gps'][-1], 3)} and v at {fixed(pair['v_gps'][-1], 3)}.",
    )


def _same_image(summary: Summary) -> Finding:
    two, six = (_figure(summary, t, "L1", "none", "mean", "y") for t in (2, 6))
    b, r2 = (_figure(summary, t, "R2", p, "mean", "y") for t, p in ((3, "A"), (7, "CL")))
    return Finding(
        "Table 2 and Table 6 print one image with opposite signs",
        f"Mean y before the calibration of the left image A is {fixed(two['paper'], 3)} px in Table 2, of the left image L1 "
        f"{fixed(six['paper'], 3)} px in Table 6.",
        "All other figures before agree to 1e-5 px, so A is L1, and one sign is a misprint. A left swing has to be negative, as "
        f"L2 and L3 are; here the median is {fixed(six['median'], 1)} px, and Table 2 has the wrong sign. Likewise B is R2 "
        f"(mean y {fixed(b['paper'], 2)} with the parameters from A, {fixed(r2['paper'], 2)} px with CL) and C is L2.",
    )


def _mean_x(summary: Summary) -> Finding:
    asked = {(row["image"], row["axis"]): row["median"] for row in summary["focal_asked_px"]}
    focal = summary["simulation"]["focal_px"]
    listed = {axis: [v for (_, a), v in asked.items() if a == axis] for axis in "xy"}
    gap = 1 - np.mean(listed["x"]) / np.mean(listed["y"])
    first = 1 - (asked["L1", "x"] + asked["R1", "x"]) / (asked["L1", "y"] + asked["R1", "y"])
    left, right = summary["mean_x_by_half_px"]
    each = ", ".join(f"{image} {value:.0f}" for (image, axis), value in asked.items() if axis == "x")
    return Finding(
        "The means of x before ask for a shorter focal length than those of y",
        "Mean x before is −84 px for L1 and R1 and −81 to −88 px for the others; mean y is −517 and +507 px.",
        f"Both are proportional to the focal length. The means of y ask for {min(listed['y']):.0f} to {max(listed['y']):.0f} px "
        f"({focal:g} was taken), those of x for {each} px: {percent(gap)} less on average, {percent(first)} for the calibrated pair. "
        "Nothing in the paper explains it, no parameter of its model can, and nothing was tuned to it: the simulation's means of x "
        "stay 4 to 5 px beyond those of L1 and R1. A part may be where the points lie: x runs through the swing (mean of the "
        f"first and second half: L1 {fixed(left['first']['median'], 0)} and {fixed(left['second']['median'], 0)}, R1 "
        f"{fixed(right['first']['median'], 0)} and {fixed(right['second']['median'], 0)} px), so points crowded on one side of the "
        "track move its mean, and the paper's six means scatter by 7 px where evenly spread points allow 1 to 3.",
    )


def _spread_y(summary: Summary) -> Finding:
    before, after = (_figure(summary, 2, "L1", p, "std", "y") for p in ("none", "A"))

    def pattern(which: str) -> float:
        return float(np.sqrt(max(before[which] ** 2 - after[which] ** 2, 0.0)))

    return Finding(
        "The spread of y before is smaller in the paper",
        f"Standard deviation of y of L1 before: {fixed(before['paper'], 2)} px; after, {fixed(after['paper'], 2)} px.",
        f"Here {fixed(before['median'], 2)} and {fixed(after['median'], 2)} px. What the calibration takes away is a pattern along "
        f"the detector and the swing: {fixed(pattern('paper'), 1)} px in the paper, {fixed(pattern('median'), 1)} px here. The "
        f"detector of ±{summary['simulation']['half_line_px']:g} px is an assumption of the scenario; points that use less of its "
        "length see less of the pattern. It was not tuned.",
    )


def _half_degree() -> Finding:
    largest = max(abs(TABLE_4[f"{n}_left"] - TABLE_4[f"{n}_right"]) for n in ("omega_pos", "phi_pos", "kappa_pos"))
    return Finding(
        "“Within 0.5°” is within 0.05°",
        "Section 3.2: the boresight angles of the two swings in Table 4 differ by less than 0.5°, as they should.",
        f"By Table 4 they differ by {fixed(largest, 4)}° at most (omega). Half a degree would be 94 px in y; that is no test of "
        "anything that the cross application shows at 9 px.",
    )


def _single(summary: Summary) -> Finding:
    one, four = (TABLE_1["omega_pos_left"], TABLE_4["omega_pos_left"]), (TABLE_1["omega_sen"], TABLE_4["omega_sen"])
    rows = {row["name"]: row for row in summary["parameters"]["4"]}
    low = [name for name, row in rows.items() if row["data_share"] < 0.5 and not row["is_combination"]]
    difference = rows["omega_pos left - right"]
    return Finding(
        "Single parameters are not what the data determine",
        f"Tables 1 and 4 give omega_pos {fixed(one[0], 4)}° and {fixed(one[1], 4)}°, omega_sen {fixed(four[0], 4)}° and "
        f"{fixed(four[1], 4)}°, and call them reasonable.",
        f"They differ by {fixed(abs(one[0] - one[1]), 4)}° each, but their sums, {fixed(one[0] + four[0], 5)}° and "
        f"{fixed(one[1] + four[1], 5)}°, by {abs(one[0] + four[0] - one[1] - four[1]):.5f}°: 0.02 px. Only the sum is determined; "
        f"how it is divided, the prior says. The same holds for {', '.join(low)}, whose variance the data reduce by less than "
        "half: a value of Tables 1 or 4 is no test of an implementation, and the simulation does not repeat them. The combinations "
        f"under the tables are: omega left − right is {fixed(difference['median'], 4)}° here, with a sigma of "
        f"{fixed(difference['sigma'], 4)}°, and {fixed(difference['paper'], 4)}° in Table 4.",
    )


def _subpixel(summary: Summary) -> Finding:
    l3, r3 = (_figure(summary, 7, image, p, "mean", "x") for image, p in (("L3", "CL"), ("R3", "CR")))
    return Finding(
        "“Sub-pixel” fails for L3 and R3",
        "Abstract: after the calibration the residuals of left and right images are below one pixel.",
        f"Mean x of L3 and R3 with their own parameters is {fixed(l3['paper'], 2)} and {fixed(r3['paper'], 2)} px in Table 7 "
        f"(here {fixed(l3['median'], 2)} and {fixed(r3['median'], 2)}, by a drift that was tuned to it), and no standard deviation "
        "but one is below 1.1 px. The means of the others are below one pixel, in part because control points' means vanish by "
        "construction.",
    )


def _order(summary: Summary) -> Finding:
    usual, other = summary["mean_x_gap_px"]
    paper = _figure(summary, 6, "L1", "none", "mean", "x")["paper"] - _figure(summary, 5, "R1", "none", "mean", "x")["paper"]
    return Finding(
        "The order of scan and pitch is not stated",
        f"R_scan “consists of the scan and the pitch angle”. Mean x before of L1 less that of R1 is {fixed(paper, 2)} px.",
        f"With {usual['order']} it is {fixed(usual['median'], 1)} px ({fixed(usual['low_5'], 1)} to {fixed(usual['high_95'], 1)} over "
        f"{usual['seeds']} seeds), with {other['order']} {fixed(other['median'], 1)} px ({fixed(other['low_5'], 1)} to "
        f"{fixed(other['high_95'], 1)}): the first is what the paper's tables want, and what is used here.",
    )
