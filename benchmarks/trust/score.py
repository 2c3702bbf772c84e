"""Whether an answer is sound, wrong, and whom it names; and how much the best test could have known."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

import whiskjax as wj

from .way import Judged

FAR_SIGMAS = 4.0
LEVEL = 1e-4  # chance of joint chi-squares of right answers beyond their bound
NOTICEABLE = 36.0  # noncentrality from which on a verdict is scored
SEEN_M = 1e-3  # ground errors smaller than that are none
FEW = 3  # names that a caution may hold and still be said to name


def is_sound(judged: Judged) -> bool:
    """Whether no reason fails the answer; what was refused is no answer."""
    return judged.reasons is not None and all(reason.grade != "failure" for reason in judged.reasons)


def is_wrong(judged: Judged) -> bool:
    """An unknown beyond four predicted sigmas, or the ground points beyond what chance does once in ten thousand."""
    if judged.reasons is None:
        return False
    off = np.abs(np.asarray(judged.error_sigmas, dtype=float))
    return not (off <= FAR_SIGMAS).all() or not judged.ground <= bound(judged.ground_freedom)


def bound(freedom: int) -> float:
    """What chi-square exceeds with the probability `LEVEL`."""
    return float(chi2.isf(LEVEL, freedom)) if freedom else 0.0


def ground_chi_square(difference_m: np.ndarray, by_unknowns: np.ndarray, covariance: np.ndarray) -> tuple[float, int]:
    """Joint chi-square of differences (n,) on the ground, whose covariance is that of the unknowns seen there; and its rank.

    Directions of which the covariance knows better than `SEEN_M` count as exact: errors there are rounding, not estimates.

    **Arguments:** `by_unknowns`: derivatives, (n, k); `covariance`: of the unknowns, (k, k).
    """
    if not (np.isfinite(difference_m).all() and np.isfinite(by_unknowns).all() and np.isfinite(covariance).all()):
        return np.inf, 1
    values, vectors = np.linalg.eigh(covariance / np.outer(*2 * [np.sqrt(np.diag(covariance))]))
    root = np.sqrt(np.diag(covariance))[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    along, length, _ = np.linalg.svd(by_unknowns @ root, full_matrices=False)
    seen = length > SEEN_M
    return float((((difference_m @ along)[seen] / length[seen]) ** 2).sum()), int(seen.sum())


def misfit_of(result: wj.RESULTS, chi_square: float) -> float:
    """The chi-square of a fit to exact data; infinite where there is no fit: of what was left out it tells nothing."""
    return chi_square if bool(result == wj.RESULTS.successful) and np.isfinite(chi_square) else float("inf")


def names_in(figures: Any) -> Iterable[str]:
    """Every text among keys and values, however deep; looks given by number as they are labelled."""
    if isinstance(figures, str):
        yield figures
    elif isinstance(figures, Mapping):
        for key, value in figures.items():
            yield str(key)
            looks = key == "looks" and isinstance(value, Sequence)
            yield from (f"look {i}" for i in value if isinstance(i, int)) if looks else names_in(value)
    elif isinstance(figures, np.ndarray):
        yield from names_in(figures.tolist())
    elif isinstance(figures, list | tuple | set | frozenset):
        for value in figures:
            yield from names_in(value)


def says(text: str, name: str) -> bool:
    """Whether a text is the name, or holds it as a whole word: "image L1, point 7" names L1, and "L1-07" does not."""
    return re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", text) is not None


def who(reasons: Iterable[wj.Reason] | None, culprits: Sequence[str], *, few: bool = False) -> frozenset[tuple[str, str]]:
    """Kinds of failures and cautions, with the culprits that their figures name.

    **Arguments:** `few`: only of reasons that name no more than `FEW` of anything.
    """
    found = set()
    for reason in reasons or ():
        texts = list(names_in(reason.figures))
        if reason.grade == "note" or (few and _most(reason.figures) > FEW):
            continue
        found |= {(reason.kind, name) for name in culprits if any(says(text, name) for text in texts)}
    return frozenset(found)


def _most(figures: Mapping[str, Any]) -> int:
    """The length of the longest list of names among figures."""
    lists = [list(v) for v in figures.values() if isinstance(v, Mapping | list | tuple)]
    return max((len(each) for each in lists if any(isinstance(x, str) for x in each)), default=0)


def scaled(factor: float, residuals: float) -> float:
    """Twice the expected log likelihood ratio of so many residuals that are `factor` times as large as stated."""
    return residuals * (factor**2 - 1 - 2 * np.log(factor))


def alike(covariance: np.ndarray, taken: int) -> float:
    """The same of whitened errors that have a covariance (n, n) in place of 1, of which the fit takes `taken` dimensions.

    By Cauchy's interlacing the eigenvalues left are no larger, and no smaller, than those `taken` places further on: the largest
    are given away, so that the figure is a lower bound. Copies have no density beside errors that are none: infinite.
    """
    values = np.linalg.eigvalsh(covariance)
    if values.min() < 1e-9:
        return float("inf")
    gain = np.sort(values - 1 - np.log(values))
    return float(gain[: len(gain) - taken].sum())


def gain(rows: np.ndarray, covariance: np.ndarray) -> float:
    """Twice the expected log likelihood ratio of whitened errors with a covariance (m, m) in place of 1, as a fit leaves them.

    A fit sees of errors what no unknown can take: their part across the whitened derivatives `rows` (m, k), priors among them.
    """
    k = rows.shape[1]
    across = np.linalg.qr(rows, mode="complete")[0][:, k:]
    values = np.linalg.eigvalsh(across.T @ covariance @ across)
    return float((values - 1 - np.log(values)).sum()) if values.min() > 1e-9 else float("inf")
