"""From prior to posterior: how far each unknown moved and how much its sigma shrank."""

import numpy as np

from ...estimate.number_checks import PRIOR_ONLY
from ..plain import Summary
from ..style import CHECK, CONTROL, INK, MUTED, NORMAL, SMALL, Drawing, dress, new_figure, shortened
from ..tables import decimals_of, fixed

_PRIOR = "#DADADA"


def draw_shrinkage(summary: Summary) -> Drawing:
    """Left: value and sigma on the scale of the prior. Right: prior sigma over posterior sigma."""
    parameters = summary["parameters"]
    k = len(parameters)
    font = NORMAL if k <= 20 else SMALL - 0.5
    figure = new_figure(1.3 + 0.27 * max(k, 3))
    left, right, words = figure.subplots(1, 3, sharey=True, width_ratios=[1.2, 0.8, 0.85])
    ends = [
        abs(p["from_prior_sigmas"]) + p["sigma"] / p["prior_sigma"]
        for p in parameters
        if p["from_prior_sigmas"] is not None and p["sigma"] is not None
    ]
    reach = max(2.2, 1.1 * max(ends, default=0.0))
    ratios = [_ratio(p) for p in parameters]
    furthest = max((r for r in ratios if r is not None), default=10.0)
    for row, (p, ratio) in enumerate(zip(parameters, ratios, strict=True)):
        colour = CHECK if p["data_share"] is not None and p["data_share"] < PRIOR_ONLY else CONTROL
        decimals = decimals_of(p["sigma"])
        unit = "" if p["unit"] == "1" else f" {p['unit']}"
        said = f"{fixed(p['value'], decimals)} ± {fixed(p['sigma'], decimals)}{unit}" if p["sigma"] else "not determined"
        if p["from_prior_sigmas"] is not None and p["sigma"]:
            left.barh(row, 2, left=-1, height=0.72, color=_PRIOR, linewidth=0, zorder=1)
            z, half = p["from_prior_sigmas"], p["sigma"] / p["prior_sigma"]
            left.plot([z - half, z + half], [row, row], color=colour, linewidth=3, solid_capstyle="butt", zorder=3)
            left.plot([z], [row], "o" if colour == CONTROL else "^", color=colour, markersize=5, zorder=4)
        else:
            why = "no prior" if p["prior_sigma"] is None else "not determined"
            box = {"facecolor": "white", "edgecolor": "none", "pad": 2}
            left.text(0, row, why, fontsize=font, color=MUTED, ha="center", va="center", bbox=box, zorder=4)
        if ratio is not None:
            right.barh(row, max(ratio, 1.0) - 1, left=1, height=0.72, color=colour, linewidth=0, zorder=2)
            said = f"{said}  ({_times(ratio)})"
        words.text(0, row, said, fontsize=font, color=INK, va="center")
    left.set_yticks(range(k), [shortened(p["name"]) for p in parameters], fontsize=font)
    left.set_ylim(k - 0.4, -0.6)
    left.set_xlim(-reach, reach)
    left.locator_params(axis="x", nbins=6)
    left.axvline(0, color=MUTED, linewidth=0.8, zorder=2)
    left.set_xlabel("shift from the prior mean (prior sigmas)")
    right.set_xscale("log")
    right.set_xlim(1, max(10.0, 1.1 * furthest))
    right.set_xlabel("prior sigma / new sigma (no unit)")
    decades = int(np.log10(max(10.0, 1.1 * furthest)))
    ticks = 10.0 ** np.arange(0, decades + 1, max(1, decades // 4))
    right.set_xticks(ticks, [f"{t:g}" for t in ticks])
    right.minorticks_off()
    right.tick_params(axis="y", left=False)
    words.set_axis_off()
    words.set_xlim(0, 1)
    words.set_title("value ± sigma (shrunk by)", fontsize=font, loc="left")
    for axes in (left, right):
        dress(axes, grid="x")
    left.tick_params(axis="y", labelsize=font, length=0)
    caption = (
        "Left: grey is the prior (mean ± sigma), the point and its bar what the calibration made of it. Right: how many times "
        "smaller the sigma became. Orange triangles are unknowns that only their prior holds."
    )
    return Drawing("prior_posterior", "What the data added to the prior", caption, figure)


def _ratio(p: Summary) -> float | None:
    return p["prior_sigma"] / p["sigma"] if p["prior_sigma"] and p["sigma"] else None


def _times(ratio: float) -> str:
    return f"{ratio:.0f}×" if ratio >= 10 else f"{ratio:.1f}×" if ratio >= 1.1 else f"{ratio:.2f}×"
