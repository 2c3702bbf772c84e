"""The checks of a verdict on made-up evidence: what each finds, by textbook reckoning; the same traced and in a batch."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from whiskjax.chain.address import parse
from whiskjax.estimate import checks
from whiskjax.estimate.check_points import CheckTest
from whiskjax.estimate.estimate import Estimate
from whiskjax.estimate.evidence import Evidence, Seen, Words
from whiskjax.estimate.model_test import consistency
from whiskjax.estimate.reason import FAILURE, FINE, by_weight, is_sound, judged, warnings
from whiskjax.estimate.variance_components import Components
from whiskjax.rules import RESULTS

NAMES = ("a", "b", "c", "d")
N = 30
WORDS = Words("it converged", "rays", "ray", "residuals", "rays were left out", "look for blunders", "start nearer")


def evidence(covariance=None, prior_share=None, cost=50.0, freedom=50, result=RESULTS.successful, names=NAMES, **more):
    """An answer in order, but for what is said."""
    k = len(names)
    covariance = np.eye(k) if covariance is None else covariance
    rng = np.random.default_rng(0)
    estimate = Estimate(
        value=np.zeros(k),
        covariance=covariance,
        prior_share=np.full(k, 0.01) if prior_share is None else np.asarray(prior_share),
        cost=cost,
        freedom=freedom,
        result=result,
        names=names,
        places=tuple((parse(f"mount.lever_arm_m[{i}]"),) for i in range(k)),
    )
    factor, tail, _ = consistency(cost, freedom)
    everyone = np.ones(N, dtype=bool)
    fields = {
        "estimate": estimate,
        "estimated": np.ones(k, dtype=bool),
        "shift": np.zeros(k),
        "scale": np.full(k, 2.0),
        "rows": rng.normal(size=(2 * N, k)),
        "variance_factor": factor,
        "freedom": freedom,
        "tail": tail,
        "candidate": everyone,
        "used": everyone,
        "outlying": ~everyone,
        "code": np.zeros(N, dtype=np.int32),
        "beside": ~everyone,
        "record": 1e3 * rng.normal(size=(N, 5)),
        "image": np.repeat([0, 1, 2], N // 3),
        "most": 0.5,
        "kinks": (),
        "label": lambda i: f"ray {i}",
        "images": ("im0", "im1", "im2"),
        "words": WORDS,
        "check": CheckTest(4.0, 6, 0.68, ("P1",), (1.2,)),
    }
    fields |= more
    seen = Seen(**{name.name: fields.pop(name.name) for name in dataclasses.fields(Seen) if name.name in fields})
    return Evidence(**fields, seen=seen)


def some(which):
    chosen = np.zeros(N, dtype=bool)
    chosen[which] = True
    return chosen


def twice(*pairs):
    """Records of which some are those of others."""
    record = 1e3 * np.random.default_rng(0).normal(size=(N, 5))
    for copy, of in pairs:
        record[copy] = record[of]
    return record


def correlated(*pairs):
    rho = np.eye(4)
    for i, j, value in pairs:
        rho[i, j] = rho[j, i] = value
    return rho * np.outer([1, 2, 3, 4], [1, 2, 3, 4])


ROWS = np.random.default_rng(1).normal(size=(60, 4))
LIKE = ROWS @ np.array([[1.0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]])  # a and b alike, nothing depends on d
STRETCHED = Components(("x", "y"), np.zeros(2, bool), np.full(2, 9), np.array([1.0, 50.0]), 0.01 * np.eye(2))
UNTESTED = CheckTest(0.0, 0, 1.0, (), ())
CONTRADICTED = CheckTest(90.0, 6, 1e-17, ("P1", "P2"), (9.0, 2.0))
NOWHERE = CheckTest(math.nan, 6, math.nan, (), ())

# What is wrong; which check says so, of which grade, what it says, and what of its figures.
WRONG = {
    "not converged": ({"result": RESULTS.not_converged}, "solution", "failure", "did not converge", {"unknowns": []}),
    "a number that nothing determines": (
        {"result": RESULTS.rank_deficient, "covariance": np.diag([1.0, math.inf, 1.0, 1.0])},
        "solution", "failure", ": b", {"unknowns": ["b"]},
    ),
    "impossible": (
        {"code": np.where(some([4, 7]), 6, 0).astype(np.int32)}, "solution", "failure", "ray 4: ", {"measurement": "ray 4"},
    ),
    "check points": ({"check": CONTRADICTED}, "check points", "failure", "P1 (9 sigma)", {"points": {"P1": 9.0, "P2": 2.0}}),
    "check points nowhere": ({"check": NOWHERE}, "check points", "failure", "not a number", {}),
    "no check points": ({"check": UNTESTED}, "check points", "note", "no check points", {}),
    "stretched": ({"components": STRETCHED}, "sigmas", "failure", "of y are 50 times larger", {"group": "y"}),
    "too large": ({"cost": 200.0}, "consistency", "failure", "2 times as large", {"sigma_factor": 2.0}),
    "too small": ({"cost": 8.0}, "consistency", "caution", "0.4 times as large", {"sigma_factor": 0.4}),
    "nothing left over": ({"freedom": 0, "cost": 0.0}, "consistency", "caution", "nothing checks", {"degrees_of_freedom": 0}),
    "left out": ({"outlying": some([3, 20])}, "left out", "caution", "2 of 30 rays", {"measurements": ["ray 3", "ray 20"]}),
    "most left out": ({"outlying": some(range(16))}, "left out", "failure", "more than 50%", {"count": 16, "of": 30}),
    "of one image": ({"outlying": some(range(4))}, "one image", "caution", "of image im0", {"image": "im0", "count": 4}),
    "beside": ({"beside": some([5])}, "beside the detector", "caution", "ray 5 lies far", {"measurement": "ray 5"}),
    "copies": ({"record": twice((9, 2), (11, 2))}, "copies", "caution", "3 times", {"measurements": ["ray 2"], "times": [3]}),
    "kinks": ({"kinks": (("delay", "body"),)}, "kinks", "caution", "body is interpolated", {"unknown": "delay", "link": "body"}),
    "untouched": ({"rows": LIKE}, "rank", "caution", "no ray depends on d", {"unknowns": ["d"]}),
    "correlated": (
        {"covariance": correlated((0, 1, 0.93))}, "correlation", "caution", "a and b are strongly", {"unknowns": ["a", "b"]},
    ),
    "not told apart": (
        {"covariance": correlated((0, 1, -0.99), (1, 3, 0.92))},
        "correlation", "caution", "a, b and d cannot", {"unknowns": ["a", "b", "d"], "correlation": pytest.approx(-0.99)},
    ),
    "priors alone": ({"prior_share": [0.96, 0.2, 0.999, math.nan]}, "prior alone", "caution", "a, c", {"unknowns": ["a", "c"]}),
    "far": ({"shift": np.array([0.0, -4.0, math.nan, 1.0])}, "far from the prior", "caution", "b 4.0", {"sigmas": {"b": -4.0}}),
}  # fmt: skip


def told(e):
    return by_weight(judged(checks.CHECKS, e))


def test_an_answer_in_order_gives_notes_alone():
    found = told(evidence())
    assert {reason.grade for reason in found} == {"note"} and is_sound(found) and warnings(found) == ()
    assert {reason.kind for reason in found} == {"solution", "check points", "consistency"}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_said_by_its_check_with_its_figures(case):
    changed, kind, grade, text, figures = WRONG[case]
    found = told(evidence(**changed))
    (reason, *_) = [one for one in found if one.kind == kind]
    assert reason.grade == grade and text in reason.text
    assert figures.items() <= dict(reason.figures).items()
    assert is_sound(found) == (grade != "failure")
    assert (reason.text in warnings(found)) == (grade != "note")
    # One thing is wrong, and one check says so: copies and blunders apart, which may be of one image too.
    others = {one.kind for one in found if one.grade != "note"} - {kind, "one image", "left out"}
    assert not others


def test_moves_that_change_nothing_are_named():
    """Columns a and b are alike: a + 1 and b - 1 together do nothing; the unit of each is its own."""
    texts = [reason for reason in told(evidence(rows=LIKE)) if reason.kind == "rank"]
    (move,) = [reason.figures["move"] for reason in texts if "move" in reason.figures]
    assert (
        set(move) == {"a", "b"} and move["a"] == pytest.approx(-move["b"]) and max(map(abs, move.values())) == pytest.approx(2.0)
    )
    assert texts[-1].figures["rank"] == 2 and "2 of 4 combinations" in texts[-1].text


def test_what_is_considered_is_not_judged_as_an_unknown():
    estimated, share = np.array([False, True, True, True]), [1.0, 0.1, 0.1, 0.1]
    assert warnings(told(evidence(covariance=correlated((0, 1, 0.99)), prior_share=share, estimated=estimated))) == ()


def test_the_first_thing_said_is_the_worst():
    found = told(evidence(cost=200.0, check=CONTRADICTED, kinks=(("delay", "body"),)))
    order = ["failure", "caution", "note"]
    assert [reason.grade for reason in found] == sorted((reason.grade for reason in found), key=order.index)


HOST = ("check points", "sigmas", "kinks")  # they say what was found on the host, or at trace time
TRACED = ("outlying", "used", "beside", "record", "code")


@pytest.mark.parametrize("check", [c for c in checks.CHECKS if c.kind not in HOST], ids=lambda c: c.kind)
def test_grades_and_figures_are_the_same_traced_and_in_a_batch(check):
    """Answers that differ in all that can be traced, side by side."""
    answers = [evidence(**changed) for changed, *_ in WRONG.values() if not changed.keys() & {"check", "components", "kinks"}]

    def arrays(e):
        codes = jax.tree.map(lambda a: np.asarray(a), e.estimate.result)
        own = e.estimate.covariance, e.estimate.prior_share, codes, e.variance_factor, e.tail, float(e.freedom), e.rows, e.shift
        return *own, *(getattr(e.seen, name) for name in TRACED)

    def judge(covariance, share, result, factor, tail, freedom, rows, shift, *rest):
        estimate = dataclasses.replace(answers[0].estimate, covariance=covariance, prior_share=share, result=result)
        fields = {"variance_factor": factor, "tail": tail, "freedom": freedom, "rows": rows, "shift": shift}
        seen = dataclasses.replace(answers[0].seen, **dict(zip(TRACED, rest, strict=True)))
        return check.figures(dataclasses.replace(answers[0], estimate=estimate, seen=seen, **fields))

    stacked = jax.tree.map(lambda *parts: jnp.stack([jnp.asarray(part) for part in parts]), *map(arrays, answers))
    grades, figures = jax.jit(jax.vmap(judge))(*stacked)
    for i, e in enumerate(answers):
        grade, alone = check.figures(e)
        assert int(grades[i]) == int(grade)
        for name, value in alone.items():
            np.testing.assert_allclose(figures[name][i], value, rtol=1e-12, atol=1e-14, err_msg=name)
    assert FINE <= int(grades.min()) and int(grades.max()) <= FAILURE
