"""What Jin et al. (2024) say against themselves, or leave open, in words whose figures come from the summary.

The report and docs/whiskbroom.md take their text from here.
"""

import math

from ...show.plain import Summary
from ...show.tables import fixed, percent
from ..finding import Finding
from .printed import TABLE_1, TABLE_4
from .summary import label


def agreement(summary: Summary) -> tuple[str, ...]:
    """Which agreement was tuned and which follows, in sentences."""
    noise = ", ".join(f"{image} {n['x']:g}/{n['y']:g}" for image, n in summary["simulation"]["noise_px"].items())
    free, hit = summary["verdict"]["without_band"], summary["verdict"]["without_band_paper_in_range"]
    kinds: dict[str, list[str]] = {}
    figures = {label(f): f for f in summary["figures"]}
    for name in summary["verdict"]["without_band_outside"]:
        kinds.setdefault(_kind(figures[name]), []).append(f"{name} ({fixed(figures[name]['paper'], 2)})")
    return (
        f"Tuned to the paper are three things, marked T: the focal length ({summary['simulation']['focal_px']:g} px, from the "
        f"mean y before), the image noise ({noise} px in x/y, from the standard deviations after) and the drift of the IMU "
        "boresight of L3 and R3 (from their residuals with their own parameters). An agreement marked T was put in.",
        "Everything else follows from Table 4 of the paper, which is the truth of the simulation, from the geometry and from the "
        "model: that a swing's parameters carry over to other images of the same swing but leave about 9 px in y on the other "
        "one, that the spread in x grows there, and how far check points scatter. The priors are the scenario's; the paper does "
        "not print its weights.",
        f"Of {free} printed figures without a band, {hit} lie within the 5 % to 95 % range of the seeds; nine in ten would if "
        "the paper's flight were one more seed. Those that do not: "
        + "; ".join(f"{kind}: {', '.join(names)}" for kind, names in sorted(kinds.items()))
        + ".",
    )


def findings(summary: Summary) -> tuple[Finding, ...]:
    """The contradictions and open places, in the order of the paper."""
    spread = _figure(summary, 6, "L1", "none", "std", "x")
    return (
        _swing(summary),
        _same_image(summary),
        _mean_x(summary),
        _spread_y(summary),
        Finding(
            "The “variance” is a standard deviation",
            "Sections 3.1 and 3.2 announce “mean and variance” of the residuals; the tables' headings say standard deviation.",
            f"They are standard deviations: that of x of L1 before, {fixed(spread['paper'], 1)} px, follows from Table 4 and is "
            f"{fixed(spread['median'], 1)} px here as a standard deviation. All tables here hold standard deviations (n − 1).",
        ),
        _half_degree(summary),
        _single(summary),
        _subpixel(summary),
        _worse(summary),
        Finding(
            "The conclusion names the wrong images",
            "Parameters “computed from two pairs of left and right images (L2, R2 and L3, R3)” can be applied to other images.",
            "Section 3.2 and the caption of Table 4 say that they come from L1 and R1, and Table 7 could not look as it does "
            "otherwise: an image that takes part keeps no mean of its own, but L3 and R3 have −1.6 and −2.0 px in x. Here L1 and "
            "R1 are calibrated, and L2, R2, L3 and R3 take no part.",
        ),
        _order(summary),
    )


def _kind(figure: Summary) -> str:
    """Why a figure of the paper may lie outside the range of the seeds."""
    if figure["parameters"] == "none" and (figure["statistic"], figure["axis"]) in (("mean", "x"), ("mean", "y"), ("std", "y")):
        return "before the calibration (see below)"
    if figure["points"] == "control" and figure["statistic"] == "mean":
        return "means that vanish by construction (here to less than a tenth of a pixel)"
    return "without an explanation but chance"


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
    ends = {
        p["first"]: f"{fixed(p['correlation'][0], digits)} and {fixed(p['correlation'][-1], digits)}"
        for p in summary["correlation_by_scan"]["pairs"]
        for digits in [5 if p["first"] in ("omega_pos", "u_gps", "v_gps") else 2]
    }
    return Finding(
        "Does the correlation grow with the swing?",
        "The abstract and the introduction say that the mountings of camera and POS become more correlated at large scan angles; "
        "section 2.1 says that their correlation falls.",
        f"Both, by parameter. From one left image whose points reach to ±{scans[0]}° and to ±{scans[-1]}°, without priors: "
        f"phi_pos with phi_sen {ends['phi_pos']}, kappa_pos with kappa_sen {ends['kappa_pos']}, w_gps with w_sen "
        f"{ends['w_gps']}: these come apart. omega_pos with omega_sen {ends['omega_pos']}: both turn about the scan axis and "
        "never separate; in a narrow swing every other parameter blurs them too, which hides it. Nor do the lever arms come "
        f"apart: u {ends['u_gps']}, v {ends['v_gps']}.",
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
    x, y = ([value for (_, axis), value in asked.items() if axis == wanted] for wanted in "xy")
    mean = [f for f in summary["figures"] if (f["parameters"], f["statistic"], f["axis"]) == ("none", "mean", "x")]
    span = {which: max(f[which] for f in mean) - min(f[which] for f in mean) for which in ("paper", "median")}
    pair = 1 - (asked["L1", "x"] + asked["R1", "x"]) / (asked["L1", "y"] + asked["R1", "y"])
    each = ", ".join(f"{image} {value:.0f}" for (image, axis), value in asked.items() if axis == "x")
    halves = " and ".join(
        f"{row['image']} {fixed(row['first']['median'], 0)} and {fixed(row['second']['median'], 0)} px"
        for row in summary["mean_x_by_half_px"]
    )
    return Finding(
        "The means of x before ask for a shorter focal length than those of y",
        "Mean x before is −84 px for L1 and R1 and −81 to −88 px for the others; mean y is −517 and +507 px.",
        f"Both are proportional to the focal length. The means of y ask for {min(y):.0f} to {max(y):.0f} px, L1 and R1 for most "
        f"({summary['simulation']['focal_px']:g} px was taken), those of x for {each} px: {percent(1 - sum(x) / sum(y))} "
        f"less on average, {percent(pair)} for the calibrated pair. Nothing in the paper explains it (with the angles of Table "
        "4, the lever arms would have to be off by more than a metre), and nothing was tuned to it. A part may be where the "
        f"points lie: x runs through the swing (means of its first and second half: {halves}), so points crowded on one side of "
        f"the track would move its mean. The paper's six means span {fixed(span['paper'], 1)} px, those here, with evenly spread "
        f"points, {fixed(span['median'], 1)} px.",
    )


def _spread_y(summary: Summary) -> Finding:
    before, after = (_figure(summary, 2, "L1", p, "std", "y") for p in ("none", "A"))
    pattern = {which: fixed(max(before[which] ** 2 - after[which] ** 2, 0.0) ** 0.5, 1) for which in ("paper", "median")}
    return Finding(
        "The spread of y before is smaller in the paper",
        f"Standard deviation of y of L1 before: {fixed(before['paper'], 2)} px; after, {fixed(after['paper'], 2)} px.",
        f"They are {fixed(before['median'], 2)} and {fixed(after['median'], 2)} px. What the calibration takes away is a pattern "
        f"along the detector and the swing: {pattern['paper']} px in the paper, {pattern['median']} px here. The detector of "
        f"±{summary['simulation']['half_line_px']:g} px is an assumption of the scenario; points that use less of its length "
        "see less of the pattern. It was not tuned.",
    )


def _half_degree(summary: Summary) -> Finding:
    largest = max(abs(TABLE_4[f"{n}_left"] - TABLE_4[f"{n}_right"]) for n in ("omega_pos", "phi_pos", "kappa_pos"))
    half_px = summary["simulation"]["focal_px"] * math.radians(0.5)
    cross = _figure(summary, 7, "R2", "CL", "mean", "y")
    return Finding(
        "“Within 0.5°” is within 0.05°",
        "Section 3.2: the boresight angles of the two swings in Table 4 differ by less than 0.5°, as they should.",
        f"By Table 4 they differ by {fixed(largest, 4)}° at most (omega), which is the {fixed(abs(cross['paper']), 1)} px in y "
        f"of the cross application. Half a degree would be {half_px:.0f} px: a limit that says nothing.",
    )


def _single(summary: Summary) -> Finding:
    pos, sen = ([table[name] for table in (TABLE_1, TABLE_4)] for name in ("omega_pos_left", "omega_sen"))
    total = [a + b for a, b in zip(pos, sen, strict=True)]
    single, apart = (math.radians(abs(v[0] - v[1])) * summary["simulation"]["focal_px"] for v in (pos, total))
    rows = {row["name"]: row for row in summary["parameters"]["4"]}
    low = [name for name, row in rows.items() if row["data_share"] < 0.5 and not row["is_combination"]]
    difference = rows["omega_pos left - right"]
    return Finding(
        "Single parameters are not what the data determine",
        f"Tables 1 and 4 give omega_pos {fixed(pos[0], 4)}° and {fixed(pos[1], 4)}° (left), omega_sen {fixed(sen[0], 4)}° and "
        f"{fixed(sen[1], 4)}°, and call them reasonable.",
        f"Each differs by {fixed(abs(pos[0] - pos[1]), 3)}°, or {fixed(single, 1)} px in y, but the sums {fixed(total[0], 5)}° "
        f"and {fixed(total[1], 5)}° agree to {fixed(apart, 2)} px: only the sum is determined, and the prior divides it. "
        f"In Table 4 the data reduce the variance of {', '.join(low)} by less than half, so no implementation can be tested by "
        "them, and the simulation does not repeat them. The combinations under the tables can: omega left − right is "
        f"{fixed(difference['median'], 4)}° here (sigma {fixed(difference['sigma'], 4)}°) and {fixed(difference['paper'], 4)}° "
        "in Table 4.",
    )


def _subpixel(summary: Summary) -> Finding:
    l3, r3 = (_figure(summary, 7, image, p, "mean", "x") for image, p in (("L3", "CL"), ("R3", "CR")))
    smallest = min(f["paper"] for f in summary["figures"] if f["statistic"] == "std")
    return Finding(
        "“Sub-pixel” fails for L3 and R3",
        "Abstract: after the calibration the mean residuals of left and right images are below one pixel.",
        f"Mean x of L3 and R3 with their own parameters is {fixed(l3['paper'], 2)} and {fixed(r3['paper'], 2)} px in Table 7, "
        f"and section 3.2 says “less than 2 pixels”. In the simulation it is {fixed(l3['median'], 2)} and "
        f"{fixed(r3['median'], 2)} px, by a drift that was tuned to it. The means of the others are below one pixel, but single "
        f"points are not: the smallest standard deviation printed is {fixed(smallest, 2)} px.",
    )


def _worse(summary: Summary) -> Finding:
    own, other = (_figure(summary, 7, "R3", p, "std", "x") for p in ("CR", "CL"))
    return Finding(
        "R3 is worse with its own parameters",
        "Conclusion: a swing's own parameters reduce mean and standard deviation further than the other's.",
        f"The standard deviation of x of R3 is {fixed(own['paper'], 1)} px with CR, its own, and {fixed(other['paper'], 1)} px "
        f"with CL (simulated {fixed(own['median'], 1)} and {fixed(other['median'], 1)}). Within 15 minutes its boresight has "
        "turned by more than the two swings differ, which no set of constant parameters can follow; that drift was tuned.",
    )


def _order(summary: Summary) -> Finding:
    usual, other = (
        f"With {row['order']} it is {fixed(row['median'], 1)} px ({fixed(row['low_5'], 1)} to {fixed(row['high_95'], 1)} over "
        f"the first {row['seeds']} seeds)"
        for row in summary["mean_x_gap_px"]
    )
    left, right = (_figure(summary, t, image, "none", "mean", "x")["paper"] for t, image in ((6, "L1"), (5, "R1")))
    return Finding(
        "The order of scan and pitch is not stated",
        f"R_scan “consists of” the scan and the pitch angle. Mean x before of L1 less that of R1 is {fixed(left - right, 2)} px.",
        f"{usual}. {other}. The first is what the paper's tables want, and what is used here.",
    )
