"""Sets on which bounds hold: what is proved is proved again and by other means, what is assumed is said."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import integrators, plants, simulate
from jaxobs.certificates import exact
from jaxobs.designs import (
    Absorbing,
    Box,
    Infeasible,
    Invariant,
    absorbing,
    around,
    band,
    corner_lmi,
    data,
    everywhere,
    lpv_from,
    lpv_lmi,
    proved_channels,
    regional,
    saturated,
)
from jaxobs.observers import Luenberger

LORENZ = plants.Lorenz()


def ellipsoid(x):
    return x[0] ** 2 + x[1] ** 2 + (x[2] - 38) ** 2


@pytest.fixture(scope="module")
def lorenz_set():
    """A chain of absorbing sets: an ellipsoid, in it a cylinder, in that a slab."""
    first = absorbing(LORENZ, ellipsoid, 3)
    second = absorbing(LORENZ, lambda x: x[1] ** 2 + (x[2] - 28) ** 2, 3, within=first)
    return absorbing(LORENZ, lambda x: x[0] ** 2, 3, within=second)


def test_the_lorenz_ellipsoid_has_its_known_radius(lorenz_set):
    """max of (rho + sigma)^2 b^2 / (4 (b - 1)) (Sparrow, The Lorenz Equations, 1982, appendix C)."""
    first = lorenz_set.within.within
    b = 8 / 3
    assert first.level == pytest.approx(38**2 * b**2 / (4 * (b - 1)), rel=2e-6)
    radius = math.sqrt(first.level)
    assert np.allclose(first.upper, [radius, radius, 38 + radius], rtol=2e-6)
    assert first.verify()
    assert not first.assumed
    assert "from every start" in first.state


def test_the_chain_of_sets_sharpens_the_box(lorenz_set):
    assert np.all(lorenz_set.upper < [28.93, 28.93, 56.93])
    assert np.all(lorenz_set.lower > [-28.93, -28.93, -0.93])
    assert lorenz_set.verify()
    run = simulate(
        LORENZ, Luenberger(LORENZ, jnp.zeros((3, 1))), x0=[80.0, -90.0, 150.0], xhat0=[0.0] * 3, ts=np.arange(4001) * 0.005
    )
    late = np.asarray(run.x)[2000:]
    assert np.all((late >= lorenz_set.lower) & (late <= lorenz_set.upper))
    assert np.max(np.abs(late[:, 1])) > 20  # the box is not far from the attractor


def test_a_false_proof_is_refused(lorenz_set):
    first = lorenz_set.within.within
    assert not dataclasses.replace(first, level=first.level * 0.99).verify()
    assert not dataclasses.replace(first, upper=first.upper * 0.999).verify()
    assert not dataclasses.replace(first, rate=0.0).verify()
    assert not dataclasses.replace(lorenz_set.within, within=None).verify()  # a cylinder alone does not rule out an escape
    with pytest.raises(Infeasible):
        absorbing(LORENZ, lambda x: x @ x, 3)  # the cross terms do not cancel
    with pytest.raises(ValueError, match="quadratic polynomial"):
        absorbing(LORENZ, lambda x: x[0] ** 4, 3)


def test_absorbing_sets_for_all_inputs():
    """x' = -x + u, |u| <= 2: |x| <= 2 is absorbing in the limit."""
    found = absorbing(lambda x, u: -x + u, lambda x: x[0] ** 2, 1, inputs=([-2.0], [2.0]))
    assert isinstance(found, Absorbing)
    assert found.level == pytest.approx(4.0, rel=1e-4)
    assert found.level >= 4.0
    assert found.upper[0] == pytest.approx(2.0, rel=1e-4)


@pytest.mark.slow
def test_lorenz_from_any_start_with_any_estimate(lorenz_set):
    """Absorbing set and saturated observer: a certificate without a condition on state or estimate."""
    plant = saturated(LORENZ, lorenz_set)
    channels = proved_channels(plant, lorenz_set)
    observer, certificate = lpv_lmi(plant, bounds=channels, rate=1.0)
    assert certificate.verify()
    assert "conditional" not in certificate.origin
    assert "from every start" in certificate.origin
    assert "its estimate is anything" in certificate.origin
    run = simulate(LORENZ, observer, x0=[1.0, 2.0, 20.0], xhat0=[500.0, -300.0, 900.0], ts=np.arange(2001) * 1e-3 * 2)
    error = np.linalg.norm(np.asarray(run.xhat - run.x), axis=1)
    p = np.array(certificate.p)
    spread = math.sqrt(np.linalg.cond(p))
    inside = np.asarray(run.x)
    assert np.all((inside >= lorenz_set.lower) & (inside <= lorenz_set.upper))
    assert np.all(error <= 1.01 * spread * error[0] * np.exp(-np.asarray(run.ts)) + 1e-9)


@pytest.mark.slow
def test_invariant_ball_and_box():
    """The pendulum with friction below its upright: energy falls; x' = -x^3 + u keeps a box."""
    plant = plants.Pendulum(a=-1.0, b=0.5)

    def energy(x):  # with a cross term, so that it falls on the whole level set
        return x[1] ** 2 / 2 + (1 - jnp.cos(x[0])) + 0.2 * x[0] * x[1] + 0.05 * x[0] ** 2

    ball = Invariant([-2.0, -2.0], [2.0, 2.0], f=plant, v=energy, level=0.5, inputs=([0.0], [0.0]))
    verdict = ball.verify()
    assert verdict, verdict.why
    assert verdict.margins["boxes"] > 4
    pushed = dataclasses.replace(ball, inputs=([-1.0], [1.0]), max_boxes=64)
    assert "not proved: V' < 0 where V = 0.5" in pushed.verify().why
    assert "not proved: V > 0.5 where" in dataclasses.replace(ball, upper=np.array([0.5, 2.0])).verify().why
    cube = Invariant([-1.1], [1.1], f=lambda x, u: -(x**3) + u, inputs=([-1.0], [1.0]))
    assert cube.verify()
    assert not dataclasses.replace(cube, upper=np.array([0.9])).verify()
    found = lpv_from(plant, None, ball, inputs=([0.0], [0.0]))
    assert "by interval arithmetic never leaves" in found.origin
    assert found.conditional  # on the start, and on the estimate
    with pytest.raises(ValueError, match="a set whose proof fails"):
        lpv_from(plant, None, pushed, inputs=([-1.0], [1.0]))
    with pytest.raises(ValueError, match="a flow"):
        Invariant([0.0], [1.0], f=plants.Discretised(LORENZ, integrators.Euler(), jnp.asarray(0.001)))


def test_data_is_labelled():
    xs = np.random.default_rng(0).normal(size=(100, 2))
    found = data(xs, margin=0.1)
    spread = np.ptp(xs, axis=0)
    assert np.allclose(found.upper - found.lower, 1.2 * spread)
    assert found.state.startswith("conditional on staying here: within the extremes of 100 samples")
    assert found.assumed
    assert "conditional on staying here" in lpv_from(plants.VanDerPolSeen(), None, found).origin
    with pytest.raises(ValueError, match=r"data\.xs"):
        data(xs[:0])
    with pytest.raises(ValueError, match=r"data\.margin"):
        data(xs, margin=-1.0)


def test_room_around_a_set_feeds_a_regional_certificate(lorenz_set):
    wide = around(lorenz_set, [3.0, 3.0, 3.0])
    assert np.all(wide.lower <= lorenz_set.lower - 3)
    assert "and while |e1| <= 3" in wide.state
    model = lpv_from(LORENZ, None, wide)
    assert "conditional on its estimate" not in model.origin
    gain, _ = corner_lmi.synthesise(model.model, rate=1.0)
    found = regional(
        model.model,
        gain,
        inner=(lorenz_set.lower, lorenz_set.upper),
        outer=(wide.lower, wide.upper),
        rate=1.0,
        origin=model.origin,
    )
    assert found.verify()
    p, level = exact.matrix(found.p), found.level
    assert exact.is_positive_definite(p)
    assert np.all(np.sqrt(level * np.diag(np.linalg.inv(np.array(found.p)))) <= 3.0 + 1e-9)  # the ellipsoid is within the room
    with pytest.raises(ValueError, match=r"around\.width"):
        around(lorenz_set, 0.0)


def test_boxes_bands_and_bounds():
    assert not everywhere(2).assumed
    assert everywhere(2).state == "for every state"
    assert Box([0.0, -math.inf], [1.0, math.inf]).state == "conditional on the state staying in x1 in [0.0, 1.0]"
    bounds = Box([0.0], [2.0]).bounds(lambda x: x**3)
    assert (bounds.lower[0, 0], bounds.upper[0, 0]) == (0.0, 12.0)
    bounds = Box([-1.0, -1.0], [1.0, 1.0]).bounds(plants.Pendulum(), ([-0.5], [0.5]))
    assert bounds.upper[1, 0] == pytest.approx(math.sqrt(1.25), rel=2e-6)
    strip = band([[1.0, 1.0]], [-1.0], [1.0])
    t, low, high, names = strip.coordinates
    assert names == ("(x1 + x2)", "x2")
    assert (low.tolist(), high.tolist()) == ([-1.0, -math.inf], [1.0, math.inf])
    assert np.array_equal(np.array([[1.0, 1.0], [0.0, 1.0]]) @ t, np.eye(2))
    with pytest.raises(ValueError, match=r"Band\.rows"):
        band([[3.0, 0.0]], [0.0], [1.0])
    with pytest.raises(ValueError, match="lower <= upper"):
        Box([1.0], [0.0])
