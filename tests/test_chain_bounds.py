"""The constants of V = e'P^-1 e against scipy's Riccati solution, exact linear gains and closed forms."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from oracles import riccati

from jaxobs import chain_bounds

ALPHAS, RHO = [3.0, 2.0], 1.5


def test_the_constants_of_the_proof_against_scipy():
    @jax.jit
    def ours(a, g, r):
        injected = [chain_bounds.noise_injection(a, g, order) for order in range(a.shape[0])]
        rates = g * chain_bounds.metric_rate(a), chain_bounds.decay_rate(a, g, r), chain_bounds.optimality_weight(a, g, r)
        matrices = (*chain_bounds.riccati_pair(a, g), chain_bounds.normalised_weight(a, g))
        return rates, matrices, chain_bounds.diagonal_ratios(a), jnp.stack(injected)

    for alphas, gamma, rho in ((ALPHAS, 6.0, 1.5), ([4.0, 6.0, 4.0, 1.0], 45.0, 1.5)):
        rates, matrices, ratios, injected = ours(*map(jnp.asarray, (alphas, gamma, rho)))
        p, q = riccati.solve(alphas, gamma)
        left, right = riccati.parts(alphas, gamma)
        root = np.linalg.inv(scipy.linalg.sqrtm(p))
        np.testing.assert_allclose(rates, [left, left - rho * right, (left - rho * right) * left], rtol=1e-5)
        np.testing.assert_allclose(matrices[0], p, rtol=1e-6)
        np.testing.assert_allclose(matrices[1], q, rtol=1e-12)
        np.testing.assert_allclose(matrices[2], root @ q @ root, rtol=1e-4, atol=1e-4 * left)
        np.testing.assert_allclose(ratios, gamma * np.diag(p) / np.diag(q), rtol=1e-6)
        directions = [p[:, 0], *np.eye(len(alphas))[: len(alphas) - 1]]
        np.testing.assert_allclose(injected, [np.linalg.norm(root @ b) for b in directions], rtol=1e-5)


@pytest.mark.parametrize("alphas", [ALPHAS, [3.0, 3.0, 1.0], [4.0, 6.0, 4.0, 1.0], [2.7, 3.1, 1.4]])
def test_lemma_3(alphas):
    for first, second in ((6.0, 5.9), (6.0, 1.0), (1.0, 1.3)):
        one, other = riccati.solve(alphas, first)[0], riccati.solve(alphas, second)[0]
        found = float(chain_bounds.growth(jnp.asarray(alphas), jnp.asarray(first / second)))
        assert found == pytest.approx(scipy.linalg.eigvalsh(one, other)[0], rel=1e-6)
        assert (found > 1) == (first > second)


def test_the_iss_gain_bounds_the_exact_linear_one():
    """The exact peak gain of the linear part, the integral of |impulse response|, is below the bound at rho -> 0."""
    compiled = jax.jit(chain_bounds.iss_gain, static_argnums=3)
    for q, alphas in ((0, ALPHAS), (2, [4.0, 6.0, 4.0, 1.0])):
        for gamma in (2.0, 8.0):
            bound = compiled(jnp.asarray(alphas), jnp.asarray(gamma), jnp.asarray(1e-9), q)
            gain = np.array(alphas) * gamma ** np.arange(1.0, len(alphas) + 1)
            k = np.eye(len(alphas), k=1) - np.outer(gain, np.eye(len(alphas))[0])
            b = gain if q == 0 else np.eye(len(alphas))[q - 1]
            ts = np.linspace(0, 60 / gamma, 6001)
            step = scipy.linalg.expm(k * ts[1])
            path = [b]
            for _ in ts[1:]:
                path.append(step @ path[-1])
            exact = scipy.integrate.trapezoid(np.abs(path), ts, axis=0)[q:]
            assert np.all(exact < bound)
            assert np.all(bound < 100 * exact)
    at = [compiled(jnp.asarray(alphas), jnp.asarray(g), jnp.asarray(1e-9), 2) for g in (10.0, 20.0)]
    np.testing.assert_allclose(at[1] / at[0], [1.0, 2.0], rtol=1e-6)  # gamma^{j-1}, whatever q is
    assert np.all(np.isinf(compiled(jnp.asarray(ALPHAS), jnp.asarray(5.0), jnp.asarray(RHO), 0)))


@pytest.mark.parametrize("n", [1, 2, 4])
def test_gauthier_1992_has_the_same_gain_for_binomial_alphas(n):
    theta = 3.0
    s = np.asarray(chain_bounds.gauthier_metric(n, jnp.asarray(theta)))
    a, c = riccati.chain(n)
    np.testing.assert_allclose(-theta * s - a.T @ s - s @ a + c.T @ c, 0, atol=1e-12)
    gain = [math.comb(n, i) * theta**i for i in range(1, n + 1)]
    np.testing.assert_allclose(np.linalg.solve(s, c[0]), gain, rtol=1e-10)
    p, _ = riccati.solve([math.comb(n, i) for i in range(1, n + 1)], theta)
    np.testing.assert_allclose(p[:, 0], gain, rtol=1e-6)


def test_the_bandwidth_of_a_state_bounds_the_period():
    dt = 0.01
    ts = jnp.asarray(np.arange(2000) * dt)
    wide = chain_bounds.bandwidth(jnp.sin(3 * ts) + 0.5 * jnp.sin(20 * ts), jnp.asarray(dt))
    assert float(wide) == pytest.approx(20, rel=0.05)
    assert float(chain_bounds.shannon_period(wide)) == pytest.approx(np.pi / 20, rel=0.05)


def test_the_bounds_differentiate():
    a, g, r = jnp.asarray(ALPHAS), jnp.asarray(9.0), jnp.asarray(0.1)
    rate, slope = jax.jit(jax.value_and_grad(chain_bounds.decay_rate, argnums=1))(a, g, r)
    left, right = zip(*(riccati.parts(ALPHAS, gamma) for gamma in (9.0, 9.0 + 1e-4, 9.0 - 1e-4)), strict=True)
    expected = [x - 0.1 * y for x, y in zip(left, right, strict=True)]
    assert float(rate) == pytest.approx(expected[0], rel=1e-6)
    assert float(slope) == pytest.approx((expected[1] - expected[2]) / 2e-4, rel=1e-4)
