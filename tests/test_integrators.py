"""Orders of convergence, exactness at any stiffness, tolerance, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import jaxobs
from jaxobs import hurwitz
from jaxobs.integrators import RK4, Adaptive, Euler, Exponential, Field
from jaxobs.observers import HighGain, Luenberger, Sampled, Tracker
from jaxobs.plants import Duffing, IntegratorChain, Pendulum

A = np.asarray([[0.0, 1.0], [-4.0, -3.0]])


def rest(t, z, w, xp=jnp):
    return xp.stack([xp.sin(z[1]), xp.cos(t) * w]), xp.cos(t) - w * z[0]


def flow(t, state):
    b, dw = rest(t, *state)
    return A @ state[0] + b, dw


FIELD = Field(flow, lambda t, state: ((jnp.asarray(A), None), rest(t, *state)))
START = (np.asarray([1.0, -0.5]), np.asarray(0.3))


def marcher(integrator, field):
    """(start, steps, end) -> the state after that many equal steps from 0 to `end`, compiled once."""

    @jax.jit
    def run(start, steps, dt):
        cache = integrator.prepare(field, dt, start)
        step = lambda k, z: integrator.step(field, cache, k.astype(dt.dtype) * dt, dt, z)  # noqa: E731
        return jax.lax.fori_loop(0, steps, step, start)

    return lambda start, steps, end=1.0: run(jax.tree.map(jnp.asarray, start), steps, jnp.asarray(end / steps))


def reference(end=1.0):
    def joined(t, s):
        b, dw = rest(t, s[:2], s[2], np)
        return np.concatenate([A @ s[:2] + b, [dw]])

    return scipy.integrate.solve_ivp(joined, (0, end), [*START[0], START[1]], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


@pytest.mark.parametrize(("integrator", "order"), [(Euler(), 1), (RK4(), 4), (Exponential(), 4)])
def test_order_of_convergence(integrator, order):
    counts, march, exact = np.asarray([10, 20, 40, 80]), marcher(integrator, FIELD), reference()
    errors = [np.max(np.abs(np.hstack(march(START, n)) - exact)) for n in counts]
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert abs(slope - order) < 0.15


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_adaptive_keeps_its_tolerance(rtol):
    error = np.max(np.abs(np.hstack(marcher(Adaptive(rtol=rtol, atol=rtol), FIELD)(START, 2)) - reference()))
    assert error < 10 * rtol


@pytest.mark.parametrize("kind", [Euler, RK4, Exponential])
def test_substeps_are_shorter_steps(kind):
    fine, coarse = marcher(kind(), FIELD)(START, 12), marcher(kind(substeps=4), FIELD)(START, 3)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-14), fine, coarse)


@pytest.mark.filterwarnings("ignore::jaxobs.integrators.UnstableStep")
def test_exponential_is_exact_at_any_stiffness():
    """A constant measurement into the chain observer at gamma = 1000, n = 5, gamma dt = 10: far beyond explicit methods."""
    n, gamma, dt, y, steps = 5, 1e3, 0.01, 0.7, 20
    alphas = np.asarray(hurwitz.binomial(n))
    scale = gamma ** np.arange(1, n + 1)
    start = np.asarray([1.0, -2.0, 0.5, 3.0, -1.0])  # in scaled coordinates z_i / gamma^i
    f = gamma * (np.eye(n, k=1) - np.outer(alphas, np.eye(n)[0]))
    settled = np.zeros(n)
    settled[0] = y / gamma

    def marcher(integrator):
        observer = Sampled(HighGain(IntegratorChain(n), alphas, gamma), integrator, dt)

        @jax.jit
        def run(xhat0, y, count):
            step = lambda k, z: observer.step(k, z, jnp.zeros(0), y)  # noqa: E731
            return jax.lax.fori_loop(0, count, step, observer.init(xhat0))[0]

        return lambda count: run(jnp.asarray(start * scale), jnp.asarray([y]), count) / scale

    exponential = marcher(Exponential())
    for count in (1, 2, steps):
        exact = settled + scipy.linalg.expm(f * dt * count) @ (start - settled)
        np.testing.assert_allclose(exponential(count), exact, rtol=0, atol=1e-12)
    assert np.max(np.abs(marcher(RK4())(steps))) > 1e12


def test_exponential_refuses_what_has_no_linear_part():
    ts, ys = np.arange(5) * 0.1, np.zeros(5)
    with pytest.raises(ValueError, match=r"without split.*RK4 or Adaptive"):
        jaxobs.observe(Tracker(2, 0, 3.0), ts, ys, xhat0=[0, 0], integrator=Exponential())
    with pytest.raises(ValueError, match=r"Luenberger\.model: given Duffing.*RK4 or Adaptive"):
        jaxobs.observe(Luenberger(Duffing(), [[1.0], [1.0]]), ts, ys, xhat0=[0, 0], integrator=Exponential())


def test_exponential_refuses_an_uneven_grid():
    observer, ts = HighGain(Pendulum(), [1.5, 1], 3.0), [0, 0.1, 0.2, 0.5, 0.6]
    with pytest.raises(ValueError, match="even spacing"):
        jaxobs.simulate(
            Pendulum(), observer, x0=[0, 0], xhat0=[0, 0], ts=ts, integrator=Exponential(), signal=jaxobs.signals.Zero(1)
        )


def test_adaptive_that_gives_up_is_reported_as_divergence():
    observer, ts = HighGain(IntegratorChain(2), [1.5, 1], 3.0), np.linspace(0, 10, 6)
    lazy = Adaptive(rtol=1e-10, atol=1e-12, max_steps=2)
    run = jaxobs.simulate(IntegratorChain(2), observer, x0=[1, 0], xhat0=[0, 0], ts=ts, integrator=lazy)
    assert run.diverged_at == ts[1]
    assert np.isfinite(run.xhat[0]).all()
    assert np.isnan(run.xhat[1:]).all()
