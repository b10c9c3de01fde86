"""The audit of a gain: its verdicts, their certificates, refusals."""

import dataclasses

import numpy as np
import pytest
from switched_cases import NONE, ONE, between, oscillator, polytope

from jaxobs.certificates import Corners, FrozenInstability, StepCorners, load
from jaxobs.designs import audit
from jaxobs.designs.polytope import Polytope


def test_a_good_gain_is_certified():
    found = audit(oscillator(2.0, 0.5, 2.0), NONE)
    assert found.verdict == "certified"
    assert isinstance(found.certificate, Corners)
    assert found.certificate.verify()
    assert found.counterexample is found.obstruction is None
    assert found.switching.growth < 0
    assert all(point.count.is_stable for point in found.frozen)


def test_a_bad_corner_is_named_exactly():
    found = audit(polytope([[0, 1], [0, 0]], [[0], [1]], ONE, [-1.0], [2.0]), [[2.0], [1.5]])
    assert found.verdict == "unstable at corner 1 (exact)"
    assert found.counterexample.rho == (2.0,)
    assert found.counterexample.verify()
    assert found.certificate is None
    assert [point.count for point in found.frozen][:2] == [(2, 0, 0), (1, 0, 1)]


def test_an_eigenvalue_on_the_axis_is_marginal_and_not_unstable():
    found = audit(oscillator(0.0, 1.0, 2.0), NONE)
    assert found.verdict == "marginal at corner 0 (exact)"
    assert found.counterexample is None


def test_an_unstable_inside_between_stable_corners_is_found():
    a, b = np.array([[-1.0, 10.0], [0.0, -1.0]]), np.array([[-1.0, 0.0], [10.0, -1.0]])
    found = audit(between(a, b), NONE)
    assert found.verdict == "unstable at centre (exact)"
    assert found.frozen[0].count.is_stable
    assert found.frozen[1].count.is_stable


def test_neither_proved_nor_disproved_is_said_as_such():
    a, b = np.array([[0.6, 0.6], [-0.6, 0.6]]), np.array([[0.5, 1.3], [0.0, 0.5]])
    found = audit(between(a, b), NONE, step=True)
    assert found.verdict == "not certified"
    assert found.obstruction.verify()
    assert "error grows" not in found.obstruction.claim
    assert 0.9 < found.switching.growth < 1
    assert found.counterexample is None


def test_discrete_gain_is_certified():
    found = audit(polytope([[0.5, 0.1], [0.0, 0.2]], [[0], [1]], ONE, [-0.1], [0.1]), NONE, step=True, search=False)
    assert found.verdict == "certified"
    assert isinstance(found.certificate, StepCorners)
    assert found.switching is None


def test_a_model_without_parameters_is_its_only_corner():
    model = Polytope(
        np.array([[0.0, 1.0], [-1.0, 0.5]]), np.zeros((2, 0)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.eye(1, 2)
    )
    assert audit(model, np.array([[2.0], [1.0]])).verdict == "certified"
    found = audit(model, NONE)
    assert found.verdict == "unstable at corner 0 (exact)"
    assert found.counterexample.verify()


def test_a_larger_rate_than_proved_is_not_certified():
    found = audit(oscillator(2.0, 0.5, 2.0), NONE, rate=5.0, search=False)
    assert found.verdict == "not certified"
    assert "decay rate" in found.reason
    assert found.obstruction.rate == 5.0
    assert found.obstruction.verify()


def test_prints_a_table():
    text = str(audit(oscillator(0.02, 0.5, 2.0), NONE))
    assert text.startswith("gain [[0.0], [0.0]]: unstable under switching (proved)")
    for part in ("corner 0", "corner 1", "centre", "worst inside", "(exact)", "none exists (exact): (0.5), (2)", "lower bound"):
        assert part in text


@pytest.mark.usefixtures("as_users_have_it")
def test_bad_gains_are_refused():
    with pytest.raises(ValueError, match=r"gain: given shape \(1, 2\).*transposed"):
        audit(oscillator(2.0, 0.5, 2.0), NONE.T)
    with pytest.raises(ValueError, match=r"audit\.gain: given .*nan.*finite"):
        audit(oscillator(2.0, 0.5, 2.0), [[np.nan], [0.0]])


def proofs():
    switching = audit(oscillator(0.02, 0.5, 2.0), NONE)
    corner = audit(polytope([[0, 1], [0, 0]], [[0], [1]], ONE, [-1.0], [2.0]), [[2.0], [1.5]])
    return corner.counterexample, switching.obstruction, switching.counterexample


def test_certificates_travel_and_do_not_hold_for_other_numbers(tmp_path):
    changes = ({"rho": (-1.0,)}, {"points": ((0.5,),)}, {"durations": (1e-3, 1e-3)})
    for k, (proof, change) in enumerate(zip(proofs(), changes, strict=True)):
        proof.to_json(tmp_path / f"{k}.json")
        again = load(tmp_path / f"{k}.json")
        assert again == proof
        assert again.verify()
        assert not dataclasses.replace(proof, **change).verify()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"rho": (3.0,)}, "the box containing rho fails"),
        ({"rho": (1.0, 1.0)}, "rho: its size does not fit"),
        ({"step": 2}, "step 0 or 1 fails"),
        ({"gain": ((1.0,),)}, "gain: its size does not fit"),
        ({"a": ((float("nan"), 1.0), (0.0, 0.0))}, "a: cannot convert NaN"),
        ({"tied": (0, 0)}, "tied: 2 numbers for 1 channels"),
        ({"upper": ()}, "upper: its size does not fit"),
    ],
)
def test_malformed_certificates_are_not_shown(change, why):
    proof = FrozenInstability(
        a=((0.0, 1.0), (0.0, 0.0)), b=((0.0,), (1.0,)), c=((1.0, 0.0),), lower=(-1.0,), upper=(2.0,), output=((1.0, 0.0),),
        gain=((2.0,), (1.5,)), rho=(2.0,),
    )  # fmt: skip
    assert proof.verify()
    verdict = dataclasses.replace(proof, **change).verify()
    assert not verdict
    assert why in verdict.why
