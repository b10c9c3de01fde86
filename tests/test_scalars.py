"""Scalar replacement against jax.vmap: whatever JAX traces, entry by entry or as a whole, has the same values."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import scalars
from jaxobs.studies.fused import fused, is_plain

LANES = 5
RNG = np.random.default_rng(0)
A = jnp.asarray(RNG.normal(size=(LANES, 3, 3)))
X = jnp.asarray(RNG.normal(size=(LANES, 3)))
BIG = jnp.asarray(RNG.normal(size=(LANES, 80)))
KEY = jax.random.key(0)
SPD = jnp.einsum("lij,lkj->lik", A, A) + 0.1 * jnp.eye(3)


def run(function, *batched, shared=(), lanes=LANES):
    """The function by entries, its arguments (lanes, ...) and then the shared ones; and which equations had no rule."""
    program, shape = scalars.trace(function, *(a[0] for a in batched), *shared)
    values = [scalars.Whole(a, True) for a in batched] + [scalars.Whole(a, False) for a in shared]
    env = dict(zip(program.inputs, map(scalars.small, values), strict=True))
    scalars.evaluate(program, program.equations, env, lanes)
    arrays = [scalars.spread(scalars.as_whole(scalars.value_of(o, program, env), lanes), lanes) for o in program.outputs]
    return jax.tree.unflatten(jax.tree.structure(shape), arrays)


FUNCTIONS = {
    "shift": lambda a, x: jnp.concatenate([x[1:], jnp.sin(x[:1])]),
    "set": lambda a, x: jnp.zeros_like(x).at[-1].set(x[0]).at[0].add(x[1]),
    "column added": lambda a, x: a.at[:, 0].add(-x),
    "product": lambda a, x: (a @ x, a @ a.T, x @ a, jnp.outer(x, x), jnp.eye(3) @ x),
    "batched product": lambda a, x: jnp.einsum("ij,ik->ijk", a, a),
    "reductions": lambda a, x: (a.sum(), a.max(axis=0), a.min(axis=1), jnp.prod(x), jnp.all(x > 0), jnp.any(a > 1, axis=0)),
    "moves": lambda a, x: (a.T, a[::-1], a[1:, :2].reshape(-1), jnp.pad(x, (1, 2)), jnp.diag(x), jnp.diagonal(a), x[:, None]),
    "select": lambda a, x: (jnp.where(x > 0, x, -x), jnp.where(a[0, 0] > 0, a, 0.0), jnp.clip(x, -0.5, x[0])),
    "folding": lambda a, x: (x * 0 + 1 - x * 1 + 0 * a[0], -(0 - x), x + jnp.zeros(3)),
    "jacobian": lambda a, x: jax.jacfwd(lambda x: jnp.stack([jnp.sin(x[0]) * x[1], x[2] ** 2, jnp.tanh(x[1])]))(x),
    "gradient": lambda a, x: jax.grad(lambda x: jnp.sum(jnp.cos(a @ x) ** 2))(x),
    "loop": lambda a, x: jax.lax.fori_loop(0, 3, lambda i, x: x + a @ x * i.astype(float), x),
    "loop over matrices": lambda a, x: jax.lax.fori_loop(0, 5, lambda i, s: (s[0] @ a / 3 + s[0][0, 1], s[1] + 1.0), (a, 0.0)),
    "scan with outputs": lambda a, x: jax.lax.scan(lambda c, row: (c + row @ x, c * row), jnp.asarray(0.0), a),
    "while": lambda a, x: jax.lax.while_loop(lambda x: jnp.sum(x**2) < 50, lambda x: 1.5 * x + 0.1, x),
    "cond": lambda a, x: jax.lax.cond(x[0] > 0, jnp.sin, jnp.cos, x),
    "sort": lambda a, x: jnp.sort(x),
    "solve": lambda a, x: jnp.linalg.solve(a, x),
    "cumulative": lambda a, x: jnp.cumsum(x),
    "position of a lane": lambda a, x: x[jnp.argmax(x)] + a[jnp.argmin(x), 1],
    "integers": lambda a, x: (jnp.floor(x).astype(int) % 3, jnp.arange(3) + 1, jnp.round(x) == 0),
    "constants": lambda a, x: (jnp.ones(3), jnp.linspace(0.0, 1.0, 4), np.float64(2.0) * x),
    "written": lambda a, x: ((x > 0).at[1].set(x[0] > 1), jax.lax.complex(x, a[0]).at[0].set(2j)),
    "dropped": lambda a, x: x.at[jnp.array([0, 9])].set(x[:2]),
    "changed in place": lambda a, x: (x.at[1].apply(jnp.sin), x.at[0].mul(3), x.at[2].max(x[0]), x[0].at[()].add(2.0)),
    "beyond the end": lambda a, x: x.at[jnp.array([0, 2, 5])].get(mode="fill", fill_value=7.0),
    "within": lambda a, x: x.at[jnp.array([0, 2])].get(mode="fill", fill_value=7.0),
    "nothing": lambda a, x: (jnp.sum(a[:0], axis=1), jnp.sum(a[:0], axis=0), jnp.einsum("ij,ij->i", a[:0], a[:0]), x[:0] * 2),
    "bits": lambda a, x: jax.lax.bitcast_convert_type(x, jnp.uint32),
    "overflow": lambda a, x: x + jnp.prod(jnp.full(3, 1e200)),
    "keys": lambda a, x: jax.random.key_data(jax.random.fold_in(KEY, jnp.argmax(x))),
    "errors": lambda a, x: eqx.error_if(x, jnp.any(x > 1e6), "too large"),
    "complex": lambda a, x: jnp.linalg.cholesky(jax.lax.complex(9 * jnp.eye(3), a - a.T)),
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_entries_have_the_values_of_vmap(name):
    expected = jax.vmap(FUNCTIONS[name])(A, X)
    for got, want in zip(jax.tree.leaves(run(FUNCTIONS[name], A, X)), jax.tree.leaves(expected), strict=True):
        assert got.shape == want.shape
        assert got.dtype == want.dtype
        np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("lower", [True, False])
@pytest.mark.parametrize("transpose", [0, 1])
@pytest.mark.parametrize("left", [True, False])
def test_factorisations_are_written_out(lower, transpose, left):
    def solve(a, b):
        return jax.lax.linalg.triangular_solve(a, b, left_side=left, lower=lower, transpose_a=bool(transpose))

    def factor(a):
        return jnp.linalg.cholesky(a)

    np.testing.assert_allclose(run(solve, SPD, A), jax.vmap(solve)(SPD, A), rtol=1e-10)
    np.testing.assert_allclose(run(factor, SPD), jax.vmap(factor)(SPD), rtol=1e-10)
    names = {e.primitive.name for e in jax.make_jaxpr(lambda a, b: (run(solve, a, b), run(factor, a)))(SPD, A).eqns}
    assert not names & {"cholesky", "triangular_solve", "dot_general"}


def test_a_matrix_that_is_not_positive_has_a_factor_of_nan():
    singular = jnp.stack([jnp.diag(jnp.asarray(d)) for d in ([1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 4.0], [jnp.nan, 1.0])])
    for matrix in (-SPD, singular):
        np.testing.assert_array_equal(run(jnp.linalg.cholesky, matrix), jax.vmap(jnp.linalg.cholesky)(matrix))


def test_large_arrays_stay_arrays():
    def function(x, weights):
        return jnp.tanh(weights @ x)[:2], x[3]

    weights = jnp.asarray(RNG.normal(size=(4, 80)))
    got, want = run(function, BIG, shared=(weights,)), jax.vmap(function, in_axes=(0, None))(BIG, weights)
    for a, b in zip(got, want, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_what_all_lanes_share_is_computed_once():
    program, _ = scalars.trace(lambda x, u: (x * jnp.sin(u), jnp.cos(u)), X[0], jnp.asarray(0.3))
    env = {program.inputs[0]: scalars.small(scalars.Whole(X, True)), program.inputs[1]: scalars.Whole(jnp.asarray(0.3), False)}
    scalars.evaluate(program, program.equations, env, LANES)
    assert scalars.differs(scalars.value_of(program.outputs[0], program, env))
    assert not scalars.differs(scalars.value_of(program.outputs[1], program, env))


def test_shifts_and_structural_zeros_cost_nothing():
    def step(x):
        return jnp.eye(3, k=1) @ x + jnp.zeros_like(x).at[-1].set(x[0])

    jaxpr = jax.make_jaxpr(lambda x: run(step, x))(X)
    assert {e.primitive.name for e in jaxpr.eqns} <= {
        "slice",
        "squeeze",
        "gather",
        "stack",
        "reshape",
        "broadcast_in_dim",
        "concatenate",
    }


KERNELS = {
    "moves on": lambda x, c: (x * 0.5 + c, c * 0.5),
    "one passes": lambda x, c: (x * 0.5, c),
    "all pass": lambda x, c: (x, c),
    "one forgotten": lambda x, c: (x * 0.5, jnp.ones_like(c)),
    "equal": lambda x, c: (x + c, x[0] + c),
}


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_computes_what_its_function_does(name):
    """XLA stops the whole process over kernels whose arguments or results it can simplify away."""

    def loop(x, c):
        return jax.lax.fori_loop(0, 4, lambda k, s: KERNELS[name](*s), (x, c))

    def blocks(x, c):
        return jax.lax.fori_loop(0, 3, lambda i, s: fused(loop, c == c, *s), (x, c))

    x, c = jnp.ones(16), jnp.asarray(0.25)
    want = (x, c)
    for _ in range(12):
        want = KERNELS[name](*want)
    text = jax.jit(blocks).lower(x, c).as_text()
    assert "xla_cpu_small_call" in text
    for got, expected in zip(jax.jit(blocks)(x, c), want, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-14)


@pytest.mark.parametrize("number", [0.0, 1.0, 2.0, -1.0])
def test_a_kernel_takes_constants(number):
    """They come from setup: the weights of an integrator, the start of a metric."""

    def loop(x, c, i, b):
        return jax.lax.fori_loop(0, 4, lambda k, x: jnp.where(b, x * c + i.astype(x.dtype), c), x)

    def run(x):
        constants = jnp.full((), number), jnp.asarray(int(number)), jnp.asarray(number > 0)
        return jax.lax.map(lambda x: fused(loop, x[0] <= x[-1], x, *constants), x.reshape(2, 16))

    x = jnp.arange(32.0)
    np.testing.assert_allclose(jax.jit(run)(x).reshape(-1), loop(x, number, jnp.asarray(int(number)), number > 0), rtol=1e-14)


def test_library_calls_stay_outside_kernels():
    assert is_plain(jax.make_jaxpr(lambda x: jax.lax.fori_loop(0, 3, lambda i, x: jnp.sin(x), x))(X).jaxpr)
    assert not is_plain(jax.make_jaxpr(lambda a: jax.lax.fori_loop(0, 3, lambda i, a: jnp.linalg.cholesky(a), a))(SPD[0]).jaxpr)
    np.testing.assert_allclose(jax.jit(lambda a: fused(jnp.linalg.cholesky, True, a))(SPD[0]), jnp.linalg.cholesky(SPD[0]))


def test_large_results_stay_outside_kernels():
    """XLA splits what fills them over threads, which it cannot do inside a kernel: the program would not link."""

    def run(x):
        return jax.lax.map(lambda x: fused(lambda x: jnp.outer(jnp.arange(128.0), x), x[0] <= x[-1], x), x.reshape(2, -1))

    x = jnp.arange(2.0 * 512)  # results of 128 x 512 numbers, 512 KiB
    np.testing.assert_allclose(jax.jit(run)(x)[1, 3], 3 * x[512:], rtol=1e-15)
