"""linalg: the closed Riccati solution, condition (5), Lyapunov solves and phi-functions, against slow solvers."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from oracles import noise, polynomial, riccati

from jaxobs import hurwitz, linalg

largest = jax.jit(linalg.largest_lipschitz)
smallest = jax.jit(linalg.smallest_gamma)
weights = jax.jit(hurwitz.q_from_alphas)
phi_functions = jax.jit(linalg.phi_functions, static_argnums=1)
PAPER = jnp.asarray([3.0, 2.0])  # paper 000, (68): s^2 + 3 s + 2


def valid_alphas(n, spread=2.0, seed=0):
    """Alphas that satisfy (10), from random weights by the root-selection oracle."""
    log_q = np.random.default_rng((seed, n)).uniform(-spread, spread, n)
    return jnp.asarray(polynomial.spectral_factor(np.exp(log_q)))


@pytest.mark.parametrize("n", range(1, 9))
@pytest.mark.parametrize("make", [hurwitz.binomial, valid_alphas])
def test_chain_riccati_equals_the_riccati_solver_at_every_gain(n, make):
    alphas = make(n)
    closed = np.asarray(linalg.chain_riccati(alphas))
    a, c = riccati.chain(n)
    terms = np.abs(a @ closed) + np.abs(closed @ a.T) + np.abs(np.outer(alphas, alphas)) + np.diag(weights(alphas))
    residual = a @ closed + closed @ a.T - closed @ c.T @ c @ closed + np.diag(weights(alphas))
    assert np.all(np.abs(residual) <= 1e-14 * np.max(terms))
    assert np.array_equal(closed[:, 0], alphas)
    assert np.all(np.linalg.eigvalsh(closed) > 0)
    for gamma in (0.5, 1.0, 4.0):
        d = gamma ** np.arange(1.0, n + 1)
        scaled = d[:, None] * closed * d[None, :] / gamma
        solved, _ = riccati.solve(np.asarray(alphas), gamma)
        # The solver loses cond(P) of 16 digits; the closed form loses none.
        assert np.max(np.abs(solved - scaled)) <= 10 * np.finfo(float).eps * np.linalg.cond(scaled) * np.max(np.abs(scaled))


def test_the_numbers_of_paper_000_71():
    left, right = riccati.parts([3.0, 2.0], 6.0)
    assert (round(left, 4), round(right, 4), round(left / right, 4)) == (3.5620, 2.2713, 1.5683)
    assert largest(PAPER, jnp.asarray(6.0)) == pytest.approx(left / right, rel=1e-12)
    p = 36 * np.asarray([[3 / 6, 2], [2, 6 * 6]])
    assert np.allclose(riccati.solve([3.0, 2.0], 6.0)[0], p, rtol=1e-12)
    assert np.allclose(
        np.linalg.inv(p), [[3 / 7 / 6, -1 / 7 / 36], [-1 / 7 / 36, 3 / 14 / 216]], rtol=1e-12
    )  # (68), signs right
    g = 6.0
    closed = 1.5 * g + 3 * g**3 + np.sqrt(36 * g**6 - 20 * g**4 + 9 * g**2) / 2  # (69)
    assert np.linalg.eigvalsh(p)[-1] == pytest.approx(closed, rel=1e-12)


@pytest.mark.parametrize(("alphas", "printed"), [((3.0, 2.0), 5.7397), ((4.0, 6.0, 4.0, 1.0), 39.6251)])
def test_smallest_gamma_for_the_lipschitz_constant_three_halves(alphas, printed):
    found = float(smallest(jnp.asarray(alphas), jnp.asarray(1.5)))
    assert round(found, 4) == printed
    assert found == pytest.approx(riccati.smallest_gamma(alphas, 1.5), rel=1e-9)
    assert largest(jnp.asarray(alphas), jnp.asarray(found)) == pytest.approx(1.5, rel=1e-12)


def test_smallest_gamma_over_six_decades_of_rho_and_under_vmap():
    rho, alphas = jnp.geomspace(1e-3, 1e3, 25), hurwitz.binomial(5)
    gammas = jax.jit(jax.vmap(linalg.smallest_gamma, (None, 0)))(alphas, rho)
    assert np.all(np.diff(gammas) > 0)
    assert np.allclose(jax.jit(jax.vmap(linalg.largest_lipschitz, (None, 0)))(alphas, gammas), rho, rtol=1e-12)


def test_gradient_of_smallest_gamma_equals_differences():
    rho, h = jnp.asarray(1.5), 1e-5
    derivative = jax.jit(jax.grad(linalg.smallest_gamma, argnums=(0, 1)))
    for alphas in (PAPER, jnp.asarray([4.0, 3.5])):
        d_alphas, d_rho = derivative(alphas, rho)
        steps = h * jnp.eye(len(alphas))
        differences = [(smallest(alphas + e, rho) - smallest(alphas - e, rho)) / (2 * h) for e in steps]
        assert np.allclose(d_alphas, jnp.stack(differences), rtol=1e-6)
        assert np.allclose(d_rho, (smallest(alphas, rho + h) - smallest(alphas, rho - h)) / (2 * h), rtol=1e-6)


@pytest.mark.parametrize("n", [1, 3, 10])
def test_largest_lipschitz_increases_with_gamma_and_depends_on_the_gain_alone(n):
    for alphas in (hurwitz.binomial(n), valid_alphas(n)):
        values = np.asarray(jax.jit(jax.vmap(linalg.largest_lipschitz, (None, 0)))(alphas, jnp.geomspace(1e-2, 1e3, 200)))
        assert np.all(np.diff(values) > 0)
        for g in (0.1, 3.0, 17.0):  # alphas_i g^i at gamma / g is the same gain
            same = largest(alphas * g ** jnp.arange(1.0, n + 1), jnp.asarray(6.0 / g))
            assert same == pytest.approx(float(largest(alphas, jnp.asarray(6.0))), rel=1e-9)


@pytest.mark.parametrize("n", range(1, 7))
@pytest.mark.parametrize("gamma", [0.7, 2.0, 6.0])
def test_largest_lipschitz_equals_the_literal_formula(n, gamma):
    alphas = valid_alphas(n)
    p, _ = riccati.solve(np.asarray(alphas), gamma)
    literal = riccati.largest_lipschitz(np.asarray(alphas), gamma)
    assert largest(alphas, jnp.asarray(gamma)) == pytest.approx(literal, rel=20 * np.finfo(float).eps * np.linalg.cond(p))


@pytest.mark.parametrize("n", [1, 2, 4, 6, 8, 10])
def test_single_precision_is_as_good_as_the_cancellation_in_the_weights_allows(n):
    eps = np.finfo(np.float32).eps
    for seed, gamma in enumerate(np.geomspace(0.1, 100, 8)):
        alphas = hurwitz.binomial(n) if seed == 0 else valid_alphas(n, 2.0, seed)
        single, gamma32 = alphas.astype(jnp.float32), jnp.float32(gamma)
        alphas = single.astype(jnp.float64)  # the same polynomial in both
        exact, ours = largest(alphas, gamma32.astype(jnp.float64)), largest(single, gamma32)
        terms = np.polymul([1, *alphas], [1, *alphas])[2::2]
        assert ours.dtype == jnp.float32
        assert abs(float(ours) / float(exact) - 1) <= 8 * eps * np.max(terms / np.asarray(weights(alphas)))


def test_nothing_is_certified_where_condition_10_fails():
    alphas = jnp.asarray([1.0, 1.0])  # s^2 + s + 1: q_1 = 1 - 2 < 0
    rho = jnp.asarray(1.0)
    assert largest(alphas, rho) == 0
    margin = jax.jit(linalg.condition5_margin)
    assert margin(alphas, rho, jnp.asarray(1.5)) == -1.5
    assert smallest(alphas, rho) == jnp.inf
    assert np.all(np.isfinite(jax.jit(jax.grad(linalg.largest_lipschitz))(alphas, rho)))
    assert margin(PAPER, jnp.asarray(6.0), rho) == pytest.approx(0.568267, abs=1e-6)


def test_nothing_is_needed_for_the_lipschitz_constant_zero():
    assert linalg.smallest_gamma(PAPER, 0) == 0
    assert linalg.smallest_gamma(jnp.asarray([1.0, 1.0]), 0) == jnp.inf
    assert jnp.isnan(smallest(PAPER, jnp.asarray(-1.0)))
    assert jnp.isfinite(jax.jit(jax.grad(linalg.smallest_gamma, argnums=1))(PAPER, jnp.asarray(0.0)))


@pytest.mark.parametrize("n", [1, 5, 8])
def test_lyapunov_equals_scipy(n):
    rng = np.random.default_rng(n)
    a = rng.normal(size=(n, n)) - 4 * np.eye(n)
    b = rng.normal(size=(n, n))
    expected = scipy.linalg.solve_continuous_lyapunov(a, -b @ b.T)
    assert np.allclose(jax.jit(linalg.lyapunov)(jnp.asarray(a), jnp.asarray(b @ b.T)), expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("n", [1, 5, 8])
def test_stein_equals_scipy(n):
    rng = np.random.default_rng(n)
    a, b = rng.normal(size=(2, n, n))
    a *= 0.9 / np.max(np.abs(np.linalg.eigvals(a)))
    expected = scipy.linalg.solve_discrete_lyapunov(a, b @ b.T)
    assert np.allclose(jax.jit(linalg.stein)(jnp.asarray(a), jnp.asarray(b @ b.T)), expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(
    ("alphas", "q", "constant"),
    [
        ((3, 2), 0, 2 / 3),
        ((2, 1), 0, 1 / 4),
        ((3, 3, 1), 1, 1 / 16),
        ((4, 6, 4, 1), 2, 1 / 32),
        ((5, 10, 10, 5, 1), 3, 5 / 256),
    ],
)
def test_noise_constants(alphas, q, constant):
    covariance = np.asarray(jax.jit(linalg.noise_covariance, static_argnums=1)(jnp.asarray(alphas, float), q))
    assert covariance[q + 1, q + 1] == pytest.approx(constant, rel=1e-12)
    assert np.allclose(covariance, noise.white(alphas, q), rtol=1e-11, atol=1e-13)
    # Held samples tend to white noise with the square of the period, and gamma only counts time.
    misses = [noise.held(alphas, q, period)[q + 1, q + 1] / constant - 1 for period in (0.02, 0.01)]
    assert abs(misses[1]) < 1e-3
    assert misses[0] / misses[1] == pytest.approx(4.0, abs=0.01)


def series(a, count):
    """phi_k(a) = sum_j a^j / (j + k)! in extended precision."""
    a = a.astype(np.longdouble)
    out = []
    for k in range(count + 1):
        term = np.eye(len(a), dtype=np.longdouble) / math.factorial(k)
        total = term.copy()
        for j in range(1, 120):
            term = term @ a / (j + k)
            total = total + term
        out.append(total.astype(float))
    return out


@pytest.mark.parametrize("n", [1, 5])
@pytest.mark.parametrize("kind", ["regular", "zero", "nilpotent", "rank one"])
def test_phi_functions_equal_their_series(n, kind):
    a = np.random.default_rng(n).normal(size=(n, n))
    a = {"regular": a, "zero": 0 * a, "nilpotent": np.triu(a, 1), "rank one": np.outer(a[0], a[-1])}[kind]
    found = phi_functions(jnp.asarray(a), 3)
    for ours, expected in zip(found, series(a, 3), strict=True):
        assert np.max(np.abs(ours - expected)) <= 1e-13 * np.max(np.abs(expected))
    assert np.allclose(found[0], scipy.linalg.expm(a), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("gamma", [1.0, 100.0])
def test_phi_functions_of_a_stiff_observer_in_scaled_coordinates(gamma):
    n, h = 5, 0.01
    alphas = np.asarray(hurwitz.binomial(n))
    d = gamma ** np.arange(1.0, n + 1)
    unit = np.eye(n, k=1)
    unit[:, 0] -= alphas
    a = d[:, None] * (gamma * unit) / d[None, :]  # shift - diag(gamma^i) alphas C
    assert np.allclose(a[:, 0] + alphas * d, 0, atol=1e-9 * d)
    found = phi_functions(jnp.asarray(a * h), 3)
    for ours, expected in zip(found, series(gamma * h * unit, 3), strict=True):
        scaled = np.asarray(ours) / d[:, None] * d[None, :]
        assert np.max(np.abs(scaled - expected)) <= 1e-13 * np.max(np.abs(expected))


def test_balance():
    d = np.asarray(jax.jit(linalg.balance)(jnp.asarray([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1e12, -1e8, -1e4]])))
    assert np.all(np.frexp(d)[0] == 0.5)
    a = np.asarray([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1e12, -1e8, 0]]) * d[None, :] / d[:, None]
    assert np.all(np.abs(np.log2(np.abs(a).sum(axis=0) / np.abs(a).sum(axis=1))) <= 2)
    assert np.array_equal(linalg.balance(jnp.diag(jnp.asarray([1.0, 1e6]))), [1, 1])


@pytest.mark.parametrize("n", range(1, 11))
def test_pascal(n):
    factor = linalg.pascal(n)
    signed = [[(-1) ** (i + j) * math.comb(i + j, i) for j in range(n)] for i in range(n)]
    assert np.array_equal(factor @ factor.T, signed)
    assert np.array_equal(factor @ np.abs(factor), np.eye(n))


def test_shift():
    assert linalg.shift(jnp.asarray([1.0, 2.0, 3.0])).tolist() == [2.0, 3.0, 0.0]
