"""Synthesis against closed forms, the Kalman filter, and inequalities evaluated by NumPy at many parameters."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import levels

from jaxobs.certificates import Corners, H2Level, L2Level, load
from jaxobs.designs import H2, L2, Gain, Infeasible, corner_lmi, prove_level, slope_entries, sweep, synthesize
from jaxobs.designs import circle as circle_design
from jaxobs.designs._conic import constant, minimise, sym, symmetric, trace, value, variables
from jaxobs.designs.polytope import Polytope
from jaxobs.papers.p002 import shared
from jaxobs.plants import AbstractLipschitz

COVERS = ("multiplier", "lazy", "corners")


def polytope(*parts) -> Polytope:
    return Polytope(*(np.array(part, float) for part in parts))


def scalar(width: float) -> Polytope:
    """e' = (rho - l) e + w - l v, |rho| <= width."""
    return polytope([[0]], [[1]], [[1]], [-width], [width], [[1]])


def chain(n: int, slope: float) -> Polytope:
    column, bound = np.eye(n)[:, -1:], np.full(n, slope)
    return Polytope(np.eye(n, k=1), np.tile(column, (1, n)), np.eye(n), -bound, bound, np.eye(1, n))


def crossed() -> Polytope:
    """x1' = x1 - f(x2), x2' = -2 x2 + f(x2), y = x1: x1 + x2 knows no f, which L alone cannot use."""
    return polytope([[1.0, 0.0], [0.0, -2.0]], [[-1.0], [1.0]], [[0.0, 1.0]], [-8.0], [8.0], [[1.0, 0.0]])


class Crossed(AbstractLipschitz):
    """The same as a plant, f(x2) = 4 sin(2 x2)."""

    n, m, p = 2, 0, 1

    def a(self):
        return jnp.array([[1.0, 0.0], [0.0, -2.0]])

    def b(self):
        return jnp.array([[-1.0], [1.0]])

    def c(self):
        return jnp.array([[1.0, 0.0]])

    def f(self, x):
        return 4 * jnp.sin(2 * x[1:])

    def g(self, y, u):
        return jnp.zeros(2)


def require_sound(certificate, margin: float = 0.0) -> None:
    """Exactly, by the checker; and in floats, by the oracle, inside the box as well."""
    assert certificate.verify(), certificate.verify().why
    assert max(levels.worst(certificate)) <= margin


@pytest.mark.parametrize("cover", COVERS)
def test_h2_of_one_state(cover):
    """level(l) = (1 + l^2) / (2 (l - width)), least at l = width + sqrt(width^2 + 1)."""
    found = synthesize(scalar(0.5), cover=cover)
    gain = 0.5 + np.sqrt(1.25)
    assert found.level == pytest.approx((1 + gain**2) / (2 * (gain - 0.5)), rel=1e-5)
    assert found.gain[0, 0] == pytest.approx(gain, rel=2e-2)  # flat there
    assert isinstance(found.certificate, H2Level)
    assert found.norm**2 == pytest.approx(found.level)
    require_sound(found.certificate)


def test_rate_binds_one_state():
    """At the rate 5 the least gain is 5 + width, and the noise would have it smaller."""
    found = synthesize(scalar(0.5), rate=5.0)
    assert found.gain[0, 0] == pytest.approx(5.5, rel=1e-4)
    assert found.level == pytest.approx((1 + 5.5**2) / 10, rel=1e-3)
    assert found.certificate.rate == 5.0
    least = synthesize(scalar(0.5), objective=Gain(), rate=5.0)
    assert least.level == pytest.approx(5.5, rel=1e-4)
    assert isinstance(least.certificate, Corners)
    require_sound(least.certificate)


def test_energy_gain_of_one_state():
    """sup over omega of |(1, -l)| / |i omega + l - width| = sqrt(1 + l^2) / (l - width)."""
    proof = prove_level(scalar(0.5), [[3.0]], objective=L2(), rate=0.0)
    assert isinstance(proof, L2Level)
    assert proof.level == pytest.approx(np.sqrt(10) / 2.5, rel=1e-5)
    assert levels.peak_gain(proof) <= proof.level
    found = synthesize(scalar(0.5), objective=L2(), seed=[[3.0]])
    assert 1 < found.level < proof.level  # 1 is approached as l grows
    require_sound(found.certificate)


@pytest.mark.parametrize("cover", COVERS)
def test_without_uncertainty_it_is_the_kalman_filter(cover):
    rng = np.random.default_rng(4)
    a, output, process, noise, weight = (rng.normal(size=s) for s in ((3, 3), (1, 3), (3, 2), (1, 1), (2, 3)))
    model = polytope(a, np.ones((3, 1)), np.ones((1, 3)), [0.0], [0.0], output)
    found = synthesize(model, objective=H2(weight, process, noise), cover=cover)
    assert found.level == pytest.approx(levels.kalman(a, output, process, noise, weight), rel=1e-3)
    assert found.level >= levels.frozen(found.certificate) * (1 - 1e-9)


@pytest.fixture(scope="module")
def three():
    """The 3-chain at the rate 0.3, by each cover."""
    return {cover: synthesize(chain(3, 1 / 3), rate=0.3, cover=cover) for cover in COVERS}


def test_covers_agree(three):
    assert three["lazy"].level == pytest.approx(three["corners"].level, rel=1e-3)
    assert 1 - 1e-3 < three["multiplier"].norm / three["corners"].norm < 1.06
    for found in three.values():
        require_sound(found.certificate)
        assert found.certificate.level == found.level
        assert found.level == pytest.approx(levels.level(found.certificate), rel=1e-9)
        assert found.level >= levels.frozen(found.certificate)
        assert list(found.history) == sorted(found.history, reverse=True)


def test_separate_matrices_beat_one(three):
    """One matrix for rate and noise, as corner_lmi has it, at the same rate and the same noises."""
    gain, _ = corner_lmi.synthesise(chain(3, 1 / 3), rate=0.3)
    one = prove_level(chain(3, 1 / 3), gain, rate=0.3)
    assert three["lazy"].level < one.level


def test_never_worse_than_the_seed(three):
    best = three["lazy"]
    again = synthesize(chain(3, 1 / 3), rate=0.3, seed=best.gain, steps=1)
    assert again.seed_level == pytest.approx(best.level, rel=1e-4)
    assert again.level <= again.seed_level * (1 + 1e-6)
    assert set(again.starts) == {"seed", "one matrix"}
    slow = synthesize(chain(3, 1 / 3), rate=1.0, seed=[[2.0], [2.0], [1.0]], steps=1)
    assert slow.seed_level is None  # it does not prove this rate


def test_certificate_travels(three, tmp_path):
    own = three["corners"].certificate
    own.to_json(tmp_path / "h2.json")
    again = load(tmp_path / "h2.json")
    assert again == own
    assert again.verify()
    assert not dataclasses.replace(own, level=own.level * 0.999).verify()
    assert not dataclasses.replace(own, rate=own.rate * 1.5).verify()
    faster = prove_level(chain(3, 1 / 3), three["lazy"].gain, objective=L2(), rate=0.3)
    assert not dataclasses.replace(faster, level=faster.level * 0.99).verify()


def test_sweep_falls_with_the_rate():
    found = sweep(chain(2, 0.5), [0.2, 1.0], steps=8)
    assert [one.rate for one in found] == [0.2, 1.0]
    assert found[0].level < found[1].level


def test_rates_agree_with_the_other_search():
    """By strides in the coordinates of the last P there, by Dinkelbach's iteration here."""
    gain = np.array([[4.0], [7.0], [5.0]])
    proof = prove_level(chain(3, 1 / 3), gain, objective=Gain())
    assert proof.rate == pytest.approx(corner_lmi.largest_rate(chain(3, 1 / 3), gain), rel=1e-3)
    with pytest.raises(Infeasible, match="Ask for less") as caught:
        prove_level(chain(3, 1 / 3), gain, rate=10 * proof.rate)
    assert caught.value.best == pytest.approx(proof.rate, rel=1e-3)


def test_least_gain_of_a_chain_lies_above_its_floor():
    """Any gain that is stable at all frozen corners has L_i > g (1 + g)^(i - 1) (the all-plus corner)."""
    found = synthesize(chain(2, 0.5), objective=Gain())
    assert np.all(found.gain[:, 0] > [0.5, 0.75])
    assert found.level == pytest.approx(np.linalg.norm(found.gain))
    require_sound(found.certificate)


def test_inner_injection_proves_what_the_gain_alone_cannot():
    with pytest.raises(Infeasible, match="inner=True") as caught:
        synthesize(crossed(), rate=0.5)
    assert caught.value.best is None
    found = synthesize(crossed(), rate=0.5, inner=True)
    assert found.inner is not None
    require_sound(found.certificate)
    assert found.certificate.inner


def test_inner_injection_lowers_the_level():
    found = synthesize(chain(3, 1 / 3), rate=0.3, objective=H2(independent=True), inner=True)
    alone = synthesize(chain(3, 1 / 3), rate=0.3, objective=H2(independent=True))
    assert found.level < alone.level
    require_sound(found.certificate)


def test_circle_observer():
    plant = Crossed()
    observer, proof = circle_design(plant, bounds=slope_entries([[0.0, -8.0]], [[0.0, 8.0]]), rate=0.5)
    require_sound(proof)
    assert np.array(proof.gain) == pytest.approx(np.asarray(observer.gain), abs=0)
    assert np.array(proof.inner) == pytest.approx(np.asarray(observer.inner)[1:], abs=0)
    # the error's derivative, by the observer itself, lies where the certificate's dynamics has it
    x, z, u = jnp.array([0.3, -1.0]), jnp.array([1.1, 0.4]), jnp.zeros(0)
    t, y = jnp.array(0.0), plant.h(x, u)
    change = np.asarray(plant.flow(t, x, u) - observer.flow(t, z, u, y))
    e = np.asarray(x - z)
    ends = [levels.closed(proof, [rho])[0] @ e for rho in (-8.0, 8.0)]
    share = (change - ends[0])[1] / (ends[1] - ends[0])[1]
    assert 0 <= share <= 1
    assert change == pytest.approx((1 - share) * ends[0] + share * ends[1], rel=1e-9)


def test_undetectable_is_said_with_its_proof():
    model = polytope([[0.0, 1.0], [0.0, 1.0]], [[1.0], [0.0]], [[0.0, 1.0]], [-1.0], [1.0], [[1.0, 0.0]])
    with pytest.raises(Infeasible, match="undetectable") as caught:
        synthesize(model)
    assert caught.value.certificate.verify()


def test_conic_against_a_closed_form():
    """min tr P: A'P + P A + I <= 0 is the Lyapunov equation."""
    a = np.array([[-1.0, 2.0], [0.0, -3.0]])
    (p,) = variables(symmetric(2))
    x = minimise(trace(p), [-sym(p @ a) - constant(np.eye(2), p)])
    assert x is not None
    found = value(p, x)
    assert found @ a + a.T @ found == pytest.approx(-np.eye(2), abs=1e-6)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: synthesize(chain(2, 1.0), rate=-1.0), r"synthesize.rate: given -1.0"),
        (lambda: synthesize(chain(2, 1.0), cover="all"), r"synthesize.cover: given 'all'"),
        (lambda: synthesize("chain"), r"synthesize.lpv: given str"),
        (lambda: synthesize(chain(2, 1.0), objective="noise"), r"synthesize.objective: given str"),
        (lambda: synthesize(chain(2, 1.0), objective=H2(weight=np.eye(3))), r"H2.weight: given shape \(3, 3\)"),
        (lambda: synthesize(chain(2, 1.0), objective=L2(process=np.full((2, 1), np.nan))), r"L2.process: given .*finite"),
        (lambda: synthesize(chain(2, 1.0), seed=np.eye(2)), r"Polytope.gain: given shape \(2, 2\)"),
        (
            lambda: prove_level(chain(2, 1.0), np.ones((2, 1)), inner=np.ones((1, 2))),
            r"prove_level.inner: given shape \(1, 2\)",
        ),
        (lambda: prove_level(chain(2, 1.0), np.ones((2, 1)), rate=np.nan), r"prove_level.rate: given nan"),
    ],
)
def test_bad_input(as_users_have_it, call, says):
    with pytest.raises(ValueError, match=says):
        call()


RATES, ONE_MATRIX = (24.9, 3.05, 1.07, 0.43), (1.76e7, 3942, 269, 78)


@pytest.mark.slow
@pytest.mark.parametrize("j0", range(4))
def test_beats_the_printed_gains(j0):
    """At the rates that the printed gains of paper 002 prove on the full box, k_f = 1, unit noise, process noise on x_5."""
    gain = shared.gain(shared.row(j0, 1))[:, None]
    objective = H2(process=np.eye(5)[:, -1:])
    found = synthesize(chain(5, 0.2), objective=objective, rate=RATES[j0], seed=gain, steps=12)
    assert found.seed_level is not None
    assert found.norm < 0.75 * np.sqrt(found.seed_level)
    assert found.norm < ONE_MATRIX[j0]
    require_sound(found.certificate)


@pytest.mark.slow
@pytest.mark.parametrize(("k_f", "known"), [(1.0, 20.7), (10.0, 1.19e4), (100.0, 4.7e8)])
def test_least_certified_gains(k_f, known):
    found = synthesize(chain(5, k_f / 5), objective=Gain())
    assert found.level < known
    assert found.certificate.verify()
