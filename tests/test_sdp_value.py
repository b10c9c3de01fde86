"""Values of semidefinite programs against closed forms, and their gradients against differences of `sdp.feasible` and
`sdp.optimise`, which know nothing of JAX."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import linalg
from jaxobs.designs import _optimality, sdp
from jaxobs.designs.sdp_value import SdpProblem, sdp_value

pytestmark = pytest.mark.usefixtures("hardly_optimised")

FIRST, SECOND = (tuple(n if n == fast else pytest.param(n, marks=pytest.mark.slow) for n in (2, 3, 4, 5)) for fast in (2, 3))
SLOPE, RATE = 0.02, 0.1  # of the nonlinearity of the chain; the decay rate asked for


def gains(n):
    """All poles of the chain observer at -1.5."""
    return np.poly(np.full(n, -1.5))[1:]


def closed(gain, slope, xp):
    """A - L C with x_n' = slope x_n."""
    n = len(gain)
    return xp.asarray(np.eye(n, k=1) + slope * np.diag(np.eye(n)[-1])) - xp.outer(gain, xp.asarray(np.eye(n)[0]))


def decay(gain, p, xp):
    flows = [closed(gain, slope, xp) for slope in (-SLOPE, SLOPE)]
    return [p, *(-(f.T @ p + p @ f) - 2 * RATE * p for f in flows)]


def energy(gain, bound, q, xp):
    """The H2 level of the error by Q, with weight I, process noise on x_n' and measurement noise."""
    flows = [closed(gain, slope, xp) for slope in (-bound, bound)]
    return [-(f.T @ q + q @ f) - xp.eye(len(gain)) for f in flows]


def level(gain, q):
    return -(q[-1, -1] + gain @ q @ gain)


def differences(value, at, step=1e-2):
    """Central, one place at a time, extrapolated from two steps."""
    found = []
    for i in range(len(at)):
        d = np.zeros(len(at))
        d[i] = step * max(at[i], 0.2)
        coarse, fine = ((value(at + s * d) - value(at - s * d)) / (2 * s * d[i]) for s in (2, 1))
        found.append((4 * fine - coarse) / 3)
    return np.array(found)


@functools.cache
def margin_of(n):
    """Of the gains, (n,); and compiled with its gradient."""
    value = sdp_value(SdpProblem({"p": sdp.symmetric(n, trace=float(n))}, lambda gain, p: decay(gain, p, jnp)))
    return value, jax.jit(jax.value_and_grad(value))


@functools.cache
def level_of(n):
    """The same of the gains and of the bound on the slope, (n + 1,)."""

    def lmis(theta, q):
        return energy(theta[:-1], theta[-1], q, jnp)

    problem = SdpProblem({"q": sdp.symmetric(n)}, lmis, maximise=lambda theta, q: level(theta[:-1], q))
    return jax.jit(jax.value_and_grad(sdp_value(problem)))


@pytest.fixture(scope="module")
def small():
    """n = 2: the margin as a function of the gains."""
    return margin_of(2)[0]


def smallest(theta):
    """The matrix whose smallest eigenvalue `eigenvalue` finds."""
    return jnp.stack([jnp.stack([theta[0], theta[1]]), jnp.stack([theta[1], theta[2]])])


@pytest.fixture(scope="module")
def eigenvalue():
    def lmis(theta, t):
        return [smallest(theta) - t * jnp.eye(2)]

    return sdp_value(SdpProblem({"t": sdp.scalar()}, lmis, maximise=lambda theta, t: t))


@pytest.mark.parametrize("n", FIRST)
def test_gradient_of_the_margin_of_a_decay_rate(n):
    def reference(gain):
        found = sdp.feasible({"p": sdp.symmetric(n, trace=float(n))}, lambda p: decay(gain, p, np))
        return found.value

    value, gradient = margin_of(n)[1](gains(n))
    assert value == pytest.approx(reference(gains(n)), rel=1e-5)
    expected = differences(reference, gains(n))
    np.testing.assert_allclose(gradient, expected, rtol=1e-4, atol=1e-4 * np.max(np.abs(expected)))


@pytest.mark.parametrize("n", SECOND)
def test_gradient_of_a_guaranteed_noise_level(n):
    def reference(theta):
        unknowns, gain = {"q": sdp.symmetric(n)}, theta[:-1]
        found = sdp.optimise(unknowns, lambda q: energy(gain, theta[-1], q, np), maximise=lambda q: level(gain, q), margin=0.0)
        return found.value

    at = np.append(gains(n), SLOPE)
    value, gradient = level_of(n)(at)
    assert value == pytest.approx(reference(at), rel=1e-6)
    expected = differences(reference, at)
    np.testing.assert_allclose(gradient, expected, rtol=1e-4, atol=1e-4 * np.max(np.abs(expected)))


@pytest.mark.parametrize("n", SECOND)
def test_without_uncertainty_the_level_is_that_of_the_lyapunov_equation(n):
    """Both corners are the same inequality then, so that the duals are not unique; the derivative along the gains exists."""

    def covariance(gain):
        process = jnp.diag(jnp.eye(n)[-1])
        return -jnp.trace(linalg.lyapunov(closed(gain, 0.0, jnp), jnp.outer(gain, gain) + process))

    value, gradient = level_of(n)(np.append(gains(n), 0.0))
    expected, slope = jax.jit(jax.value_and_grad(covariance))(jnp.asarray(gains(n)))
    assert value == pytest.approx(float(expected), rel=1e-10)
    np.testing.assert_allclose(gradient[:-1], slope, rtol=1e-8)


def test_transformations_agree(eigenvalue):
    batch = jnp.asarray([[2.0, 0.4, -1.0], [1.0, -0.3, 2.0], [0.0, 1.0, 0.0]])
    each = [eigenvalue(theta) for theta in batch]
    assert each[0] == jax.jit(eigenvalue)(batch[0])
    values, gradients = jax.jit(jax.vmap(jax.value_and_grad(eigenvalue)))(batch)
    np.testing.assert_allclose(values, each, rtol=1e-12)
    for theta, gradient in zip(batch, gradients, strict=True):
        vector = np.linalg.eigh(np.asarray(smallest(theta)))[1][:, 0]
        np.testing.assert_allclose(gradient, [vector[0] ** 2, 2 * vector[0] * vector[1], vector[1] ** 2], atol=1e-9)
    direction = jnp.asarray([0.3, -1.0, 0.5])
    _, forward = jax.jvp(eigenvalue, (batch[0],), (direction,))
    assert forward == pytest.approx(float(direction @ gradients[0]), rel=1e-12)


def test_a_second_call_does_not_trace_again():
    traces = []

    def lmis(theta, t):
        traces.append(None)
        return [jnp.diag(theta) - t * jnp.eye(2)]

    value = sdp_value(SdpProblem({"t": sdp.scalar()}, lmis, maximise=lambda theta, t: t))
    assert value(np.array([1.0, 2.0])) == pytest.approx(1.0, abs=1e-9)
    count = len(traces)
    assert value(np.array([4.0, 3.0])) == pytest.approx(3.0, abs=1e-9)
    assert len(traces) == count


def test_where_it_is_a_double_one_the_gradient_is_a_supergradient(eigenvalue):
    """lambda_min is concave: v(theta + d) <= v + g'd for every d, whichever of the duals is found."""
    theta = jnp.asarray([1.0, 0.0, 1.0])
    found, gradient = eigenvalue.solution(theta), jax.grad(eigenvalue)(theta)
    assert found.spread > 0.1
    assert found.value == pytest.approx(1.0, abs=1e-9)
    assert gradient[0] + gradient[2] == pytest.approx(1.0, abs=1e-8)  # any direction that keeps it double has a derivative
    for d in np.random.default_rng(0).normal(size=(100, 3)):
        assert np.linalg.eigvalsh(np.asarray(smallest(theta + d)))[0] <= 1 + np.asarray(gradient) @ d + 1e-8


def test_an_inequality_that_is_said_twice_leaves_duals_open_and_no_gradient():
    def twice(theta, t):
        return [smallest(theta) - t * jnp.eye(2)] * 2

    doubled = sdp_value(SdpProblem({"t": sdp.scalar()}, twice, maximise=lambda theta, t: t))
    found = doubled.solution(jnp.asarray([2.0, 0.4, -1.0]))
    assert found.spread < 1e-12
    assert found.error < 1e-12


def linear(theta, x):
    """x <= theta_0 and x >= theta_1."""
    return [jnp.diag(jnp.stack([theta["high"] - x, x - theta["low"]]))]


@pytest.fixture(scope="module")
def interval():
    """max x over [low, high], |x| <= 2; theta also holds a factor, an integer and a name."""
    unknowns = {"x": sdp.scalar(reach=2.0)}
    return sdp_value(SdpProblem(unknowns, linear, maximise=lambda theta, x: theta["factor"] * x))


def point(low, high, factor=3.0):
    return {"low": low, "high": high, "factor": factor, "order": 2, "name": "interval", "count": np.arange(2)}


def test_theta_is_a_tree(interval):
    floats = {"low": 0.0, "high": 1.5, "factor": 3.0}
    value, gradient = jax.value_and_grad(lambda own: interval(point(**own)))(floats)
    assert value == pytest.approx(4.5, rel=1e-9)
    assert {name: pytest.approx(float(one), abs=1e-9) for name, one in gradient.items()} == {
        "low": 0.0, "high": 3.0, "factor": 1.5
    }  # fmt: skip


def test_where_the_reach_bounds_the_value_it_is_said_and_the_gradient_is_right(interval):
    found = interval.solution(point(0.0, 5.0))
    assert found.value == pytest.approx(6.0, rel=1e-9)
    assert found.reached == pytest.approx(1.0)
    gradient = jax.grad(lambda own: interval(point(0.0, *own)))((5.0, 3.0))
    np.testing.assert_allclose(gradient, (0.0, 2.0), atol=1e-8)


def test_what_cannot_be_satisfied_is_minus_infinity_and_has_no_gradient(interval):
    lows = jnp.asarray([0.0, 1.6, -1.0])  # above 1.5 for the second
    values, gradients = jax.vmap(jax.value_and_grad(lambda low: interval(point(low, 1.5))))(lows)
    np.testing.assert_allclose(values, [4.5, -np.inf, 4.5], rtol=1e-9)
    assert np.isnan(gradients[1])
    assert np.all(np.isfinite(gradients[jnp.asarray([0, 2])]))
    found = interval.solution(point(1.6, 1.5))
    assert found.infeasible
    assert np.isnan(found.unknowns["x"])
    assert not interval.solution(point(0.0, 1.5)).infeasible


def test_the_bound_and_the_unknowns_of_a_solution(small):
    gain = gains(2)
    found = small.solution(gain)
    matrices = decay(gain, np.asarray(found.unknowns["p"]), np)
    assert found.margin == pytest.approx(min(np.linalg.eigvalsh(one)[0] for one in matrices), abs=1e-12)
    assert found.value == pytest.approx(float(found.margin), abs=1e-9)
    assert found.gap < 1e-8
    assert found.spread == 0
    assert found.error < 1e-12
    assert sum(np.trace(z) for z in found.duals) == pytest.approx(1.0, abs=1e-9)
    bound = sdp.feasible({"p": sdp.symmetric(2, trace=2.0)}, lambda p: decay(gain, p, np)).bound
    assert found.value <= bound + 1e-9


def test_second_derivatives_and_those_of_the_pair_are_refused(small):
    with pytest.raises(ValueError, match="a first derivative of the value"):
        jax.hessian(small)(gains(2))
    with pytest.raises(ValueError, match="a first derivative of the value"):
        jax.jacfwd(lambda gain: small.solution(gain).unknowns["p"])(jnp.asarray(gains(2)))


def test_a_solver_that_is_wrong_yields_nan_or_the_right_value(interval, monkeypatch):
    theta = point(0.0, 1.5)
    honest = sdp.proposal

    def wrong_by(x, z):
        def proposal(*given):
            found, duals = honest(*given)
            return found - x, [one + z * np.eye(len(one)) for one in duals]

        return proposal

    monkeypatch.setattr(sdp, "proposal", wrong_by(1e-3, 1e-3))
    assert interval(theta) == pytest.approx(4.5, rel=1e-9)
    monkeypatch.setattr(_optimality, "STEPS", 1)  # the same without a polish
    assert np.isnan(interval(theta))
    for x, z in ((0.5, 0.0), (0.0, 10.0)):
        monkeypatch.setattr(sdp, "proposal", wrong_by(x, z))
        assert np.isnan(interval(theta))
    monkeypatch.setattr(sdp, "proposal", lambda *given: (None, []))
    found = interval.solution(theta)
    assert np.isnan(found.value)
    assert found.gap == np.inf
    assert not found.infeasible


def test_numbers_that_are_not_finite_yield_nan(interval):
    assert np.isnan(interval(point(np.nan, 1.5)))
    assert np.isnan(interval(point(0.0, np.inf)))


def test_bad_problems_are_refused(as_users_have_it):
    unknowns = {"p": sdp.symmetric(2)}
    for name, given in (
        ("unknowns", ({}, lambda theta, p: [p])),
        ("unknowns", ({"p": 2}, lambda theta, p: [p])),
        ("unknowns", ([sdp.symmetric(2)], lambda theta, p: [p])),
        ("unknowns", ({"p": sdp.symmetric(1, trace=1.0)}, lambda theta, p: [p], lambda theta, p: 0.0)),
        ("lmis", (unknowns, [np.eye(2)])),
        ("maximise", (unknowns, lambda theta, p: [p], 1.0)),
        ("margin", (unknowns, lambda theta, p: [p], None, 1e-8)),
        ("margin", (unknowns, lambda theta, p: [p], jnp.trace, np.nan)),
    ):
        with pytest.raises(ValueError, match=rf"SdpProblem\.{name}.*: given .*; expected "):
            SdpProblem(*given)
    with pytest.raises(ValueError, match=r"sdp_value\.tolerance: given 0"):
        sdp_value(SdpProblem(unknowns, lambda theta, p: [p]), tolerance=0.0)
    with pytest.raises(ValueError, match=r"sdp_value\.problem: given dict"):
        sdp_value(unknowns)


NILPOTENT = np.array([[0.0, 1.0], [0.0, 0.0]])


@pytest.mark.parametrize(
    ("match", "lmis", "maximise"),
    [
        ("asymmetry", lambda theta, p: [p @ NILPOTENT + theta], None),
        ("affine", lambda theta, p: [p @ p + theta * NILPOTENT @ NILPOTENT.T], None),
        pytest.param("affine", lambda theta, p: [p], lambda theta, p: jnp.linalg.det(p), marks=pytest.mark.slow),
        (r"F_0 float64\[2\]; expected float64", lambda theta, p: [p[0]], None),
        (r"F_0 float64\[2, 1\]; expected float64", lambda theta, p: [p[:, :1]], None),
        ("F_0 float32", lambda theta, p: [p.astype(jnp.float32)], None),
        ("none; expected one matrix", lambda theta, p: [], None),
        (r"maximise: given float64\[2\]", lambda theta, p: [p], lambda theta, p: p[0]),
    ],
)
def test_bad_functions_are_refused(match, lmis, maximise, as_users_have_it):
    value = sdp_value(SdpProblem({"p": sdp.symmetric(2, trace=2.0)}, lmis, maximise))
    with pytest.raises(ValueError, match=match):
        value(1.0)


@pytest.mark.slow
def test_bad_functions_are_nan_under_jit():
    assert np.isnan(jax.jit(sdp_value(SdpProblem({"p": sdp.symmetric(2)}, lambda theta, p: [p @ p])))(1.0))


def test_single_precision_is_refused(small):
    with pytest.raises(ValueError, match=r"sdp_value\.theta: given float32; expected float64.*jax_enable_x64"):
        small(gains(2).astype(np.float32))
