"""hurwitz: coefficients, weights and poles of one polynomial, and the derivative between them."""

import math
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracles import polynomial

from jaxobs import hurwitz

SIZES = range(1, 11)
factor = jax.jit(hurwitz.alphas_from_log_q)
weights = jax.jit(hurwitz.q_from_alphas)


@cache
def jacobian(n):
    return jax.jit(jax.jacfwd(hurwitz.alphas_from_log_q))


def random_log_q(n, spread, seed=0):
    return np.random.default_rng((seed, n)).uniform(-spread, spread, n)


def sensitivity(alphas, log_q, eps):
    """First-order bound on the error of alphas: one rounding of each term of q, and of q = exp(log q) from a rounded log q."""
    a = np.concatenate([[1.0], alphas])
    n = len(alphas)
    terms = np.polymul(a, a)[2::2]  # sums of |alpha_j alpha_k|, j + k = 2 i
    jac = np.zeros((n, n))
    for i in range(1, n + 1):
        for k in range(max(1, 2 * i - n), min(n, 2 * i) + 1):
            jac[i - 1, k - 1] = 2 * (-1) ** (k - i) * a[2 * i - k]
    return eps * np.abs(np.linalg.inv(jac)) @ (terms + np.max(np.abs(log_q)) * np.exp(log_q))


@pytest.mark.parametrize("n", SIZES)
def test_weights_equal_the_product_with_the_mirror_image(n):
    alphas = np.random.default_rng(n).uniform(0.1, 5, n)
    scale = np.polymul([1, *alphas], [1, *alphas])[2::2]
    assert np.all(np.abs(np.asarray(weights(jnp.asarray(alphas))) - polynomial.weights(alphas)) < 8e-16 * scale)


@pytest.mark.parametrize("n", SIZES)
def test_binomial_alphas_have_binomial_weights(n):
    expected = [math.comb(n, i) for i in range(1, n + 1)]
    assert hurwitz.binomial(n).tolist() == expected
    assert weights(hurwitz.binomial(n)).tolist() == expected
    assert np.allclose(factor(jnp.log(hurwitz.binomial(n))), expected, rtol=1e-12, atol=0)


def test_the_printed_weights_are_wrong_from_n_4():
    assert polynomial.printed_weights([4, 6, 4, 1]).tolist() == [4, 16, 4, 1]
    assert weights(hurwitz.binomial(4)).tolist() == [4, 6, 4, 1]
    assert polynomial.printed_weights([3, 3, 1]).tolist() == weights(hurwitz.binomial(3)).tolist()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 6, 8, 10])
@settings(max_examples=20)
@given(data=st.data())
@example(data=None)
def test_round_trip_over_six_decades(n, dtype, data):
    corner = 7 * (-1.0) ** np.arange(n)
    draw = corner if data is None else data.draw(st.lists(st.floats(-7, 7, width=32), min_size=n, max_size=n))
    log_q = np.asarray(draw, dtype)
    alphas = np.asarray(factor(jnp.asarray(log_q)))
    assert alphas.dtype == dtype
    assert np.all(np.linalg.eigvals(np.vstack([-alphas.astype(float), np.eye(n)[:-1]])).real < 0)
    exact = np.asarray(factor(jnp.asarray(log_q, jnp.float64)))
    eps = np.finfo(dtype).eps
    assert np.all(np.abs(alphas - exact) <= 4 * sensitivity(exact, log_q.astype(float), eps))
    terms = np.polymul([1, *exact], [1, *exact])[2::2]
    back = np.asarray(weights(jnp.asarray(alphas)), float)
    # Newton ends within a few roundings of the largest term, and q = exp(log q) carries |log q| of them.
    assert np.all(np.abs(back - np.exp(log_q.astype(float))) <= 8 * eps * terms + 8 * eps * 7 * np.exp(log_q.astype(float)))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6, 8, 10])
def test_newton_finds_the_factor_that_root_selection_finds(n):
    log_q = random_log_q(n, 3)
    alphas = np.asarray(factor(jnp.asarray(log_q)))
    found = polynomial.spectral_factor(np.exp(log_q))
    # An eigenvalue solver is exact for a matrix that differs by a few eps of its norm: that, through the inverse Jacobian.
    unit = sensitivity(alphas, np.zeros(n), 1.0) * np.exp(np.max(log_q))
    assert np.all(np.abs(found - alphas) <= 1e3 * np.finfo(float).eps * unit)


@pytest.mark.parametrize("n", [4, 10])
def test_derivative_equals_central_differences(n):
    log_q = jnp.asarray(random_log_q(n, 2))
    h = 1e-5
    differences = [(factor(log_q + h * e) - factor(log_q - h * e)) / (2 * h) for e in jnp.eye(n)]
    scale = np.asarray(factor(log_q))[:, None]
    assert np.allclose(jacobian(n)(log_q) / scale, jnp.stack(differences, axis=1) / scale, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("n", [4, 10])
def test_derivative_equals_the_implicit_formula(n):
    log_q = jnp.asarray(random_log_q(n, 3))
    alphas = factor(log_q)
    forward = jax.jacfwd(hurwitz.q_from_alphas)(alphas)
    product = forward @ jacobian(n)(log_q) / jnp.exp(log_q)[:, None]
    size = np.abs(forward) @ np.abs(jacobian(n)(log_q)) / jnp.exp(log_q)[:, None]
    assert np.all(np.abs(product - np.eye(n)) <= 1e-12 * size)


def test_reverse_mode_and_second_derivative():
    log_q = jnp.asarray([0.3, -0.2, 0.5])
    gradient = jax.jit(jax.grad(lambda v: jnp.sum(jnp.log(hurwitz.alphas_from_log_q(v)))))
    hessian = jax.jit(jax.jacfwd(gradient))(log_q)
    assert np.allclose(gradient(log_q), jnp.sum(jacobian(3)(log_q) / factor(log_q)[:, None], axis=0), rtol=1e-12)
    h = 1e-5
    differences = jnp.stack([(gradient(log_q + h * e) - gradient(log_q - h * e)) / (2 * h) for e in jnp.eye(3)])
    assert np.allclose(hessian, differences, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize(
    "roots", [[-1.0], [-1, -2], [-1 + 2j, -1 - 2j], [-0.5, -3 + 1j, -3 - 1j], [-1, -2, -30, -4 + 5j, -4 - 5j]]
)
def test_poles_and_coefficients(roots):
    alphas = hurwitz.alphas_from_poles(jnp.asarray(roots, jnp.complex128))
    assert np.allclose(alphas, np.poly(roots)[1:].real, rtol=1e-13)
    assert hurwitz.is_hurwitz(alphas)
    found = np.asarray(jax.jit(hurwitz.poles)(alphas))
    assert np.allclose(np.sort_complex(found), np.sort_complex(np.asarray(roots, complex)), rtol=1e-10)


@pytest.mark.parametrize("alphas", [[-1.0], [1.0, -2.0], [0.0, 1.0], [1.0, 1.0, 3.0]])
def test_not_hurwitz(alphas):
    assert not hurwitz.is_hurwitz(alphas)


def test_vmap_equals_loop_and_poles_are_all_in_the_left_half_plane():
    log_q = jnp.asarray(np.random.default_rng(5).uniform(-7, 7, (40, 4)))
    alphas = jax.jit(jax.vmap(hurwitz.alphas_from_log_q))(log_q)
    assert np.allclose(alphas, jnp.stack([factor(row) for row in log_q]), rtol=1e-10)
    assert np.all(np.asarray(jax.jit(jax.vmap(hurwitz.poles))(alphas)).real < 0)


@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
@pytest.mark.parametrize("scale", [1e-3, 0.5, 40.0])
def test_normalise_counts_time_in_units_of_the_geometric_mean_of_the_poles(scale, dtype):
    alphas = hurwitz.binomial(4) * scale ** jnp.arange(1.0, 5.0)
    normal, g = hurwitz.normalise(alphas.astype(dtype))
    assert normal.dtype == g.dtype == dtype
    assert np.allclose(g, scale, rtol=8 * jnp.finfo(dtype).eps)
    assert np.allclose(normal, hurwitz.binomial(4), rtol=32 * jnp.finfo(dtype).eps)


def test_normalise_leaves_a_root_at_zero_alone():
    alphas = jnp.asarray([3.0, 2.0, 0.0])
    assert [np.asarray(x).tolist() for x in hurwitz.normalise(alphas)] == [[3.0, 2.0, 0.0], 1.0]
    gradient = jax.jit(jax.grad(lambda a: jnp.sum(hurwitz.normalise(a)[0])))(alphas)
    assert np.all(np.isfinite(gradient))


def test_what_has_no_answer_is_nan_and_stays_in_its_lane():
    rows = jnp.asarray([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0], [0.0, 0.0, -np.inf], [1.0, 1.0, 1.0]])
    alphas = np.asarray(jax.jit(jax.vmap(hurwitz.alphas_from_log_q))(rows))
    assert np.isfinite(alphas[[0, 4]]).all()
    assert np.isnan(alphas[1:4]).any(axis=1).all()


@pytest.mark.parametrize("make", [list, tuple, np.asarray, jnp.asarray])
def test_numbers_come_in_any_container(make):
    """(s + 1)(s + 2) and its weights (5, 4)."""
    np.testing.assert_allclose(hurwitz.q_from_alphas(make([3, 2])), [5, 4], rtol=1e-14)
    np.testing.assert_allclose(hurwitz.alphas_from_q(make([5, 4])), [3, 2], rtol=1e-12)
    np.testing.assert_allclose(hurwitz.alphas_from_log_q(make([math.log(5), math.log(4)])), [3, 2], rtol=1e-12)
    np.testing.assert_allclose(np.sort(np.real(hurwitz.poles(make([3, 2])))), [-2, -1], rtol=1e-12)
    np.testing.assert_allclose(hurwitz.alphas_from_poles(make([-1, -2])), [3, 2], rtol=1e-14)
    np.testing.assert_allclose(hurwitz.alphas_from_poles(make([-1 + 1j, -1 - 1j])), [2, 2], rtol=1e-14)
