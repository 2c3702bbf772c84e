"""What Liu et al. (2019) say against themselves or leave out, in words whose figures come from the summary."""

import math

from ...show.plain import Summary
from ..finding import Finding


def findings(summary: Summary) -> tuple[Finding, ...]:
    """In the order of the paper."""
    value = {f["what"]: math.nan if f["reached"] is None else f["reached"] for f in summary["figures"]}
    printed, iterated = value["as printed: NEES of 3 states"], value["iterated, full R: NEES of 3 states"]
    far = value["race from the paper's first guess, as printed: more than 100 m off"]
    steep, spread = value["75 deg off nadir: mean error"], value["75 deg, 10 km, looks 1 km apart: mean error"]
    one_look = value["one look onto the ellipsoid, height +-30 m: CEP50"]
    flown, too_far = value["straight flight, 74.3 deg: mean error"], value["straight flight, 78 deg: mean error"]
    shift_78, height_78 = value["78 deg: ground shift of one look"], value["78 deg: height bias, straight path"]
    shift_45, height_45 = value["45 deg: ground shift of one look"], value["45 deg: height bias, orbit"]
    return (
        Finding(
            "The covariance of the filter is wrong by orders of magnitude",
            "R = (2 px)², equation 20: the accuracy of the image registration.",
            "2 px are 20 µrad, while yaw, pitch and roll are known to 0.03 to 0.08 deg (500 to 1400 µrad) and the "
            "platform to 10 to 20 m. The estimate hardly suffers, since all looks are about equally bad; but NEES from a "
            f"first guess drawn from P0 is {printed:.1g} instead of 3. With the errors of the records carried through the "
            f"chain it is {iterated:.2f}.",
        ),
        Finding(
            "2.86 m is one draw",
            "Figure 6 and the text: 2.86 m horizontally, 0.69 m in height after 180 looks.",
            "From the printed coordinates 2.86 m is the distance in space (2.80 m horizontally, 0.61 m in height). The "
            f"mean over the runs is {value['orbit, 180 looks: mean error']:.2f} m.",
        ),
        Finding(
            "A wrong linearisation point can be fatal",
            "The filter converges from any first height within 2000 m.",
            f"On the orbit it does. From the printed first guess along a straight leg {far:.1f} % of the runs end more "
            "than 100 m off; every one of them is reported as diverged. The iterated filter loses none.",
        ),
        Finding(
            "75 deg and 20 m",
            "Figures 8b and 9: 40 looks are better than 20 m at all angles up to 75 deg and all heights.",
            f"At 75 deg and 10 km: {steep:.0f} m with looks 500 m apart. Looks 1 km apart reproduce the paper: {spread:.0f} m.",
        ),
        Finding(
            "The ellipsoid model is not as bad as its CEP",
            "Figure 10a: one look onto the ellipsoid, terrain of 30 m, CEP 130 m.",
            f"{one_look:.0f} m with a height error of 30 m (1-sigma). A height error of about 69 m would give 130 m.",
        ),
        Finding(
            "The flight test",
            "Table 2: errors of 30 and 32.5 m at off-nadir angles of 67 to 78 deg; the summary says better than 35 m at 78 deg.",
            "From the table's own coordinates the errors are 28.6 and 30.6 m in space; its CEP is the distance of one "
            f"sample. They fit 74 deg ({flown:.0f} m here); at 78 deg one expects {too_far:.0f} m. The row of the "
            "ellipsoid model (212 m horizontally for 244 m of height) asks for 41 deg.",
        ),
        Finding(
            "Refraction is not mentioned",
            "",
            f"It puts a single look {shift_78:.0f} m too far at 78 deg, and the height from many looks on a straight path "
            f"{height_78:.0f} m too high. On an orbit of constant off-nadir angle the apparent rays meet above the target by the "
            f"ground shift over the tangent of that angle: {shift_45:.2f} m at 45 deg, where {height_45:.2f} m is what we find.",
        ),
    )
