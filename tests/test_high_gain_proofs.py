"""The proofs of high-gain designs, against exact determinants and under mutation."""

import dataclasses

import numpy as np
import pytest
from chain_cases import BOUNDS, GAIN, plant
from oracles import chain_lmi as oracle

from jaxobs import certificates
from jaxobs.certificates import HighGainLmi, NoHighGainLmi
from jaxobs.designs import high_gain_lmi, smallest_theta, standard_high_gain
from jaxobs.designs.chain_proofs import refute
from jaxobs.plants import Pendulum


def proofs():
    _, hg_lmi = high_gain_lmi(plant(), bounds=BOUNDS, j0=2, theta=4.0, sigma=3.5)
    _, standard = standard_high_gain(Pendulum(), bounds=[[-1.5, 1.5], [0.0, 0.0]])
    return hg_lmi, standard, refute(BOUNDS, 1, 1.5), refute(BOUNDS, 1, 1.5, gain=GAIN)


def test_proofs_survive_a_file(tmp_path):
    for proof in proofs():
        proof.to_json(tmp_path / "c.json")
        assert certificates.load(tmp_path / "c.json") == proof
        assert proof.verify()
        assert len(proof.assumptions) >= 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"theta": 0.5, "sigma": 0.5}, "theta >= 1, 0 < sigma <= theta fails"),
        ({"sigma": 4.5}, "0 < sigma <= theta fails"),
        ({"sigma": 0.0}, "0 < sigma <= theta fails"),
        ({"sigma": 0.3}, "(31), at the corner"),
        ({"j0": 4}, "0 <= j0 <= n"),
        ({"lower": (-1.0, 0.1, 0.0)}, "(28), 0 within the bounds"),
        ({"lower": (2.0, -0.5, 0.0)}, "lower <= upper"),
        ({"upper": (1.0, 0.5, 9.0)}, "(31), at the corner"),
        ({"lower": (-9.0, -0.5, 0.0)}, "large enough for the slopes, fails"),
        ({"constant": 0.1}, "large enough for the slopes, fails"),
        ({"constant": 40.0}, "(32)"),
        ({"constant": -1.0}, "constant >= 0 fails"),
        ({"nu": 0.5}, "nu I - P > 0 fails"),
        ({"nu": 50.0}, "(32)"),
        ({"lam": 0.5}, "(31), at the corner"),
        ({"lam": -1.0}, "lambda, nu > 0"),
        ({"gain": (1.0, 1.0, 1.0)}, "(31), at the corner"),
        ({"gain": (1.0, 1.0)}, "its size does not fit"),
        ({"gain": (1.0, 1.0, float("nan"))}, "gain: cannot convert NaN"),
        ({"p": ((1.0, 0.0), (0.0, 1.0))}, "p: its size does not fit"),
        ({"p": ((1.0, 0.1, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "P > 0 fails"),
        ({"lower": (-1.0,) * 11}, "lower: its size"),
    ],
)
def test_false_claims_are_refused_with_their_reason(changes, reason):
    false = dataclasses.replace(proofs()[0], **changes)
    verdict = false.verify()
    assert not verdict
    assert reason in verdict.why


def test_a_standard_certificate_is_one_of_a_single_corner():
    standard = proofs()[1]
    assert standard.sigma == standard.theta
    assert "(31), at the corner" in dataclasses.replace(standard, upper=(1.5, 100.0)).verify().why
    slower = dataclasses.replace(
        standard, theta=1.0, sigma=1.0, gain=tuple(x / standard.theta**i for i, x in enumerate(standard.gain, 1))
    )
    assert "theta^{1+j0} lambda > 2 k nu" in slower.verify().why
    assert "large enough for the slopes" in dataclasses.replace(standard, constant=1.4).verify().why


def mutated(proof, rng):
    """One stored number changed by anything from the last digit to a factor or its sign."""
    name = rng.choice([f.name for f in dataclasses.fields(proof) if f.name != "j0" and getattr(proof, f.name) != ()])
    value = np.array(getattr(proof, name), float)
    place = tuple(rng.integers(0, s) for s in value.shape)
    factor = rng.choice([1 + 2.0**-52, 1 - 1e-9, 1 + 1e-6, 0.99, 1.05, 2.0, -1.0, 0.0])
    value[place] *= factor
    if name in ("p", "w") and rng.random() < 0.7:
        value[place[::-1]] = value[place]
    changed = value.tolist()
    as_tuple = tuple(tuple(row) if isinstance(row, list) else row for row in changed) if value.ndim else float(value)
    return dataclasses.replace(proof, **{name: as_tuple})


def judge(proof):
    match proof:
        case HighGainLmi():
            return oracle.holds_hg_lmi(proof)
        case NoHighGainLmi():
            return oracle.refutes(proof)


def test_mutations_are_judged_as_the_oracle_does():
    rng, counts = np.random.default_rng(0), {True: 0, False: 0}
    for proof in proofs():
        for _ in range(60):
            changed = mutated(proof, rng)
            if any(lo > hi for lo, hi in zip(changed.lower, changed.upper, strict=True)):
                continue
            assert changed.verify().holds == judge(changed), changed
            counts[judge(changed)] += 1
    assert min(counts.values()) > 30, counts


def test_what_is_possible_is_not_refuted():
    theta = smallest_theta(BOUNDS, 1).theta
    assert refute(BOUNDS, 1, 1.01 * theta) is None
    wrong = dataclasses.replace(refute(BOUNDS, 1, 1.5), theta=float(1.01 * theta))
    assert not wrong.verify()
    some = refute(BOUNDS, 1, 1.5, gain=GAIN)
    assert "X C' = 0 at corner" in dataclasses.replace(some, gain=()).verify().why
