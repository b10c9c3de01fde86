"""Corner designs against closed forms: one channel is the circle criterion, no channel is the spectrum."""

import dataclasses
import pickle
import time

import numpy as np
import pytest

from jaxobs.certificates import Corners, StepCorners, load
from jaxobs.designs import Infeasible, corner_lmi
from jaxobs.designs.polytope import Polytope

NONE = np.zeros(0)


def chain(n: int, slope: float) -> Polytope:
    """x_i' = x_{i+1}, x_n' = phi(x) with |dphi/dx_j| <= slope, y = x_1."""
    column, bound = np.eye(n)[:, -1:], np.full(n, slope)
    return Polytope(np.eye(n, k=1), np.tile(column, (1, n)), np.eye(n), -bound, bound, np.eye(1, n))


def one_channel(slope: float, step: bool = False) -> tuple[Polytope, np.ndarray]:
    a = np.array([[0.0, 1.0], [-1.0, -0.4]])
    a = np.eye(2) + 0.1 * a if step else a
    b = np.array([[0.0], [0.1 if step else 1.0]])
    model = Polytope(a, b, np.array([[1.0, 0.3]]), -np.ones(1) * slope, np.ones(1) * slope, np.eye(1, 2))
    return model, np.array([[0.1], [0.05]]) if step else np.array([[1.0], [0.5]])


def circle_criterion(model: Polytope, gain: np.ndarray, step: bool) -> float:
    """1 / max |c (s I - F)^-1 b| on the stability boundary: the largest slope that one P covers (bounded real lemma)."""
    f = model.a - gain @ model.output
    omega = np.linspace(0, np.pi, 200_001) if step else np.concatenate([[0], np.geomspace(1e-3, 1e3, 200_001)])
    s = np.exp(1j * omega) if step else 1j * omega
    # 2x2: (s I - F)^-1 = (s I - adj F) / det(s I - F)
    adjugate = np.array([[f[1, 1], -f[0, 1]], [-f[1, 0], f[0, 0]]])
    c, b = model.c[0], model.b[:, 0]
    response = (s * (c @ b) - c @ adjugate @ b) / (s**2 - np.trace(f) * s + np.linalg.det(f))
    return 1 / np.max(np.abs(response))


@pytest.mark.parametrize("step", [False, True])
def test_one_channel_is_the_circle_criterion(step):
    model, gain = one_channel(1.0, step)
    edge = circle_criterion(model, gain, step)
    inside, outside = (one_channel(factor * edge, step)[0] for factor in (0.999, 1.001))
    certificate = corner_lmi.prove(inside, gain, step=step)
    assert certificate.verify()
    with pytest.raises(Infeasible, match="no certificate of this kind") as caught:
        corner_lmi.prove(outside, gain, step=step)
    assert "unstable" not in str(caught.value)
    assert caught.value.margin < 0
    assert caught.value.certificate.verify()
    assert "none exists: 2 parameters exclude it, in exact arithmetic" in str(caught.value)


def test_without_channels_the_rate_is_the_spectral_abscissa():
    a = np.array([[-1.0, 5.0, 0.0], [0.0, -2.0, 3.0], [0.0, 0.0, -1.5]])
    model = Polytope(a, np.zeros((3, 0)), np.zeros((0, 3)), NONE, NONE, np.eye(1, 3))
    assert corner_lmi.largest_rate(model, np.zeros((3, 1))) == pytest.approx(1.0, rel=1e-3)
    gain = np.array([[1.0], [0.2], [0.1]])
    expected = -max(np.linalg.eigvals(a - gain @ model.output).real)
    assert corner_lmi.largest_rate(model, gain) == pytest.approx(expected, rel=1e-3)


def test_without_channels_the_factor_is_the_spectral_radius():
    a = np.array([[0.9, 0.3], [-0.2, 0.7]])
    model = Polytope(a, np.zeros((2, 0)), np.zeros((0, 2)), NONE, NONE, np.eye(1, 2))
    expected = max(abs(np.linalg.eigvals(a)))
    assert corner_lmi.largest_rate(model, np.zeros((2, 1)), step=True) == pytest.approx(expected, rel=1e-3)


def test_what_is_not_seen_decays_as_it_does_alone():
    """An unstable mode behind no output: the best rate is its own, for every gain."""
    model = Polytope(np.diag([0.3, -1.0]), np.zeros((2, 0)), np.zeros((0, 2)), NONE, NONE, np.array([[0.0, 1.0]]))
    with pytest.raises(Infeasible) as caught:
        corner_lmi.synthesise(model)
    assert caught.value.best == pytest.approx(-0.3, rel=1e-2)
    assert pickle.loads(pickle.dumps(caught.value)).best == caught.value.best


@pytest.mark.parametrize(("n", "slope"), [(2, 0.2), (2, 2000.0), (3, 2.0), (4, 20.0)])
def test_chains_of_any_stiffness(n, slope):
    model = chain(n, slope)
    gain, certificate = corner_lmi.synthesise(model, rate=0.5)
    assert certificate.verify()
    assert max(np.linalg.eigvals(f).real.max() for f in model.closed(gain)) < -0.5
    # Every gain that is stable at all frozen corners exceeds slope (1 + slope)^{i-1} (the floor of Table I's gains).
    assert all(gain[:, 0] > slope * (1 + slope) ** np.arange(n))


@pytest.mark.slow
@pytest.mark.parametrize("n", range(3, 7))
@pytest.mark.parametrize("slope", [0.2, 20.0, 2000.0])
def test_longer_and_stiffer_chains(n, slope):
    _, certificate = corner_lmi.synthesise(chain(n, slope), rate=0.5)
    assert certificate.verify()


def test_the_quietest_gain_without_channels_is_the_kalman_gain():
    """One P for rate 0 and noise, no parameters: the guaranteed variance is the variance, its minimum the Kalman filter's."""
    from scipy.linalg import solve_continuous_are

    a, c = np.array([[0.0, 1.0], [-2.0, -0.3]]), np.eye(1, 2)
    process, noise = np.diag([0.1, 0.5]), np.array([[0.2]])
    model = Polytope(a, np.zeros((2, 0)), np.zeros((0, 2)), NONE, NONE, c)
    gain, _ = corner_lmi.synthesise(model, process=process, noise=noise)
    expected = solve_continuous_are(a.T, c.T, process, noise) @ c.T / noise
    np.testing.assert_allclose(gain, expected, rtol=0.02)


def test_tied_channels_have_fewer_corners():
    free = Polytope(np.diag([-1.0, -1.0]), np.eye(2), np.eye(2), -np.ones(2) / 2, np.ones(2) / 2, np.eye(1, 2))
    tied = dataclasses.replace(free, tied=(0, 0))
    assert len(free.corners()) == 4
    assert len(tied.corners()) == 2
    assert corner_lmi.prove(tied, np.zeros((2, 1)), rate=0.4).verify()


def test_step_certificates_and_files(tmp_path):
    model, gain = one_channel(0.1, step=True)
    factor = corner_lmi.largest_rate(model, gain, step=True)
    certificate = corner_lmi.prove(model, gain, rate=min(1.0, factor * 1.001), step=True, origin="chosen for the test")
    certificate.to_json(tmp_path / "c.json")
    again = load(tmp_path / "c.json")
    assert again == certificate
    assert again.verify()
    assert "chosen for the test" in again.assumptions[-1]


@pytest.mark.parametrize("step", [False, True])
def test_a_certificate_with_anything_worse_fails(step):
    model, gain = one_channel(0.3, step)
    certificate = corner_lmi.prove(model, gain, step=step)
    p = certificate.p
    rate = {"factor": 0.5} if step else {"rate": 10.0}
    worse = [
        {"upper": (300.0,)},
        {"p": ((-p[0][0], p[0][1]), p[1])},
        {"p": ((p[0][0], p[0][1] + 1e-3), p[1])},  # not symmetric
        {"gain": ((-gain[0, 0] - 3,), (gain[1, 0],))},
        rate,
        {"lower": (1.0,), "upper": (-1.0,)},
        {"p": p[:1]},
        {"upper": (float("nan"),)},
        {"a": ((float("inf"), 0.0), (0.0, 0.0))},
        {"tied": (0, 0)},
    ]
    for change in worse:
        verdict = dataclasses.replace(certificate, **change).verify()
        assert not verdict
        assert verdict.why.startswith("not certified")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lower": [1.0]}, r"Polytope.lower: given lower\[0\] = 1 > upper\[0\] = 0.5; expected lower <= upper"),
        ({"b": np.eye(2)}, r"Polytope.b: given shape \(2, 2\); expected shape \(2, 1\)"),
        ({"upper": [np.inf]}, "Polytope.upper: given .* expected finite numbers"),
        ({"tied": (0, 1)}, "Polytope.tied"),
    ],
)
def test_bad_polytopes_are_refused(as_users_have_it, change, message):
    fields = {
        "a": np.eye(2),
        "b": np.ones((2, 1)),
        "c": np.ones((1, 2)),
        "lower": [-0.5],
        "upper": [0.5],
        "output": np.eye(1, 2),
    }
    Polytope(**fields)
    with pytest.raises(ValueError, match=message):
        Polytope(**(fields | change))


def test_bad_rates_and_gains_are_refused():
    model = chain(2, 1.0)
    with pytest.raises(ValueError, match="looks transposed"):
        corner_lmi.prove(model, np.ones((1, 2)))
    with pytest.raises(ValueError, match=r"prove.rate: given -1.0; expected a number >= 0"):
        corner_lmi.prove(model, np.ones((2, 1)), rate=-1.0)
    with pytest.raises(ValueError, match=r"synthesise.rate: given 1.5; expected a factor in \]0, 1\]"):
        corner_lmi.synthesise(model, rate=1.5, step=True)


@pytest.mark.parametrize(("a", "rate", "step"), [(0.0, 1.0, False), (1.0, 0.5, True)])
def test_a_pure_integrator_has_a_gain(a, rate, step):
    model = Polytope(np.array([[a]]), np.zeros((1, 0)), np.zeros((0, 1)), NONE, NONE, np.eye(1))
    gain, certificate = corner_lmi.synthesise(model, rate=rate, step=step)
    assert certificate.verify()
    closed = a - gain[0, 0]
    assert abs(closed) < rate if step else closed < -rate


def test_growth_is_not_certified_as_decay():
    model, gain = one_channel(0.3, False)
    certificate = corner_lmi.prove(model, gain)
    assert "rate >= 0 fails" in dataclasses.replace(certificate, rate=-1.0).verify().why


@pytest.mark.parametrize("step", [False, True])
def test_many_corners_with_numbers_of_many_digits_are_refused_at_once(step):
    tiny, n = 5e-324, 12
    small, diagonal = ((tiny,) * n,) * n, np.eye(n) / 2 if step else -np.eye(n)
    given = (tuple(map(tuple, diagonal.tolist())), small, small, (-1.0,) * n, (1.0,) * n, ((tiny,) * n,), ((tiny,),) * n)
    p = tuple(tuple(1.0 if i == j else tiny for j in range(n)) for i in range(n))
    began = time.perf_counter()
    verdict = (StepCorners(*given, p, 0.9) if step else Corners(*given, p, 0.5)).verify()
    assert "so many digits" in verdict.why
    assert time.perf_counter() - began < 30
