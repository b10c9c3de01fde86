"""Interval rules one by one: switches, integers, indices, loops, and what is assumed; and programs that have none."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs
from jaxobs import intervals, plants
from jaxobs.intervals import Interval, bound, bounded, rules_control


def ends(x: Interval) -> list[list[float]]:
    return [np.ravel(x.lower).tolist(), np.ravel(x.upper).tolist()]


def test_an_unknown_primitive_is_named_with_the_function_it_stands_in():
    @jax.jit
    def entropy(x):
        return jax.scipy.special.digamma(x)

    def model(x):
        return entropy(x) + 1.0

    with pytest.raises(intervals.UnknownPrimitiveError, match=r"digamma in entropy in model: no interval rule .*RULES"):
        bound(model, Interval(1.0, 2.0))


def test_a_rule_can_be_added(monkeypatch):
    monkeypatch.setattr(intervals.table, "RULES", intervals.RULES)
    monkeypatch.setitem(intervals.RULES, "digamma", None)  # restores the table afterwards

    @intervals.rule("digamma")
    def digamma(call, x):
        return Interval(x.lower - 1.0, x.upper)

    assert ends(bound(jax.scipy.special.digamma, Interval(1.0, 2.0))) == [[0.0], [2.0]]


def test_comparisons_have_three_values():
    x, y = Interval([0.0, 0.0, 1.0, 0.0], [1.0, 1.0, 1.0, 2.0]), Interval([2.0, 1.0, 1.0, 1.0], [3.0, 2.0, 1.0, 1.0])
    assert ends(bound(lambda a, b: a < b, x, y)) == [[1, 0, 0, 0], [1, 1, 0, 1]]
    assert ends(bound(lambda a, b: a <= b, x, y)) == [[1, 1, 1, 0], [1, 1, 1, 1]]
    assert ends(bound(lambda a, b: a > b, x, y)) == [[0, 0, 0, 0], [0, 0, 0, 1]]
    assert ends(bound(lambda a, b: a >= b, x, y)) == [[0, 0, 1, 0], [0, 1, 1, 1]]
    assert ends(bound(lambda a, b: a == b, x, y)) == [[0, 0, 1, 0], [0, 1, 1, 1]]
    assert ends(bound(lambda a, b: a != b, x, y)) == [[1, 0, 0, 0], [1, 1, 0, 1]]
    assert ends(bound(lambda a: (a == a) & ~(a < a) & (a <= a) & jnp.isfinite(a), x)) == [[1] * 4, [1] * 4]
    assert ends(bound(lambda a, b: (a < b) | (a >= b), x, y)) == [[1, 0, 1, 0], [1, 1, 1, 1]]  # the two sides are not related
    assert ends(bound(lambda a: jnp.any(a > 1.5), x)) == [[0], [1]]
    assert ends(bound(lambda a: jnp.all(a < 3.0), x)) == [[1], [1]]


def test_the_derivative_of_an_extreme_is_decided_where_the_extreme_is():
    box = Interval([1.5, -1.0, -3.0], [2.0, 1.0, -2.0])
    assert ends(bound(jax.vmap(jax.grad(lambda x: jnp.maximum(x, 0.0))), box)) == [[1, 0, 0], [1, 1, 0]]
    assert ends(bound(jax.vmap(jax.grad(lambda x: jnp.minimum(0.5, x))), box)) == [[0, 0, 1], [0, 1, 1]]
    assert ends(bound(jax.vmap(jax.grad(lambda x: jnp.clip(x, -0.5, 3.0))), box)) == [[1, 0, 0], [1, 1, 0]]
    assert ends(bound(jax.grad(jnp.max), box)) == [[1, 0, 0], [1, 0, 0]]
    overlapping = bound(jax.grad(jnp.max), Interval([0.0, -1.0, -3.0], [2.0, 1.0, -2.0]))
    assert ends(overlapping) == [[0, 0, 0], [1, 1, 0]]


def test_integers_stay_exact_and_wrap():
    n = np.array([7, -7, 9], dtype=np.int32)
    found = bound(
        lambda i: [i // 2, i % 3, jax.lax.rem(i, jnp.full_like(i, 4)), (i << 2) ^ 5, jnp.sum(i), i > 0, i.astype(float) / 2], n
    )
    assert [ends(x)[0] for x in found] == [[3, -4, 4], [1, 2, 0], [3, -3, 1], [25, -31, 33], [9], [1, 0, 1], [3.5, -3.5, 4.5]]
    assert all(x.is_point for x in found)
    assert ends(bound(lambda i: i * jnp.int32(2**30), n)) == [[-(2.0**31)] * 3, [2.0**31 - 1] * 3]
    assert ends(bound(lambda x: x.astype(int) * 2, Interval(-1.5, 3.9))) == [[-2.0], [6.0]]
    big = intervals.point(np.int64(2**53 + 1))
    assert big.lower < 2**53 + 1 < big.upper


def test_what_is_assumed_is_told():
    box = Interval(-1.0, 1.0)
    jumps = {
        "a switch": lambda x: jnp.where(x > 0, 1.0, x),
        "the sign of a number": jnp.sign,
        "floor": jnp.floor,
        "ceil": jnp.ceil,
        "rounding": jnp.round,
        "the remainder wraps": lambda x: jax.lax.rem(x, 0.3),
        "a truth value used as a number": lambda x: (x > 0) * 2.0,
        "an integer part": lambda x: x.astype(int) * 1.0,
        "the branch": lambda x: jax.lax.cond(x > 0, jnp.sin, jnp.cos, x),
        "an index": lambda x: jnp.arange(4.0)[jnp.clip(x.astype(int), 0, 3)],
        "the place of an extreme": lambda x: jnp.argmax(jnp.stack([x, 0.0])) * 1.0,
    }
    for what, f in jumps.items():
        assert any(f"continuous where {what} is undecided" in text for text in bounded(f, box).jumps), what
        assert bounded(f, Interval(0.1, 0.2)).assumptions == (), what
    extremes = [lambda x: jnp.clip(x, -0.5, 0.5), lambda x: jnp.max(jnp.stack([x, 0.0]))]
    for f in (jax.nn.relu, jnp.abs, jax.nn.softplus, jnp.tanh, *extremes):
        assert bounded(f, box).assumptions == ()
    partial = [lambda x: 1 / x, lambda x: x**-1, lambda x: x**0.3, lambda x: jnp.tan(2 * x)]
    for f in (jnp.log, jnp.sqrt, jax.lax.rsqrt, jnp.arccosh, *partial):
        found = bounded(f, box)
        assert found.jumps == ()
        assert len(found.undefined) == 1
        assert found.assumptions == found.undefined


def test_loops_and_indices_of_an_uncertain_kind(monkeypatch):
    monkeypatch.setattr(rules_control, "MAX_TURNS", 50)

    def loop(x):
        return jax.lax.while_loop(lambda y: y < 10.0, lambda y: y * 2.0, x)

    assert ends(bound(loop, Interval(3.0, 4.0))) == [[12.0], [16.0]]
    with pytest.raises(intervals.UnknownPrimitiveError, match="does not decide how many turns"):
        bound(loop, Interval(3.0, 6.0))
    with pytest.raises(intervals.UnknownPrimitiveError, match="more than"):
        bound(lambda x: jax.lax.while_loop(lambda y: y < 10.0, lambda y: y * 1.0, x), Interval(3.0, 4.0))
    with pytest.raises(intervals.UnknownPrimitiveError, match="an index that is written to"):
        bound(lambda x: jnp.zeros(4).at[x.astype(int)].set(1.0), Interval(0.0, 3.0))
    read = lambda x: jnp.asarray([5.0, 1.0, 2.0, 9.0])[x.astype(int)]  # noqa: E731
    assert ends(bound(read, Interval(0.0, 2.5))) == [[1.0], [5.0]]
    slid = lambda x: jax.lax.dynamic_update_slice(jnp.zeros(3), jnp.ones(1), (x.astype(int),))  # noqa: E731
    assert ends(bound(slid, Interval(1.0, 7.0))) == [[0.0, 0.0, 0.0], [0.0, 1.0, 1.0]]
    many = lambda x: jnp.arange(1000.0)[x.astype(int)]  # noqa: E731
    assert ends(bound(many, Interval(1.0, 900.0))) == [[0.0], [999.0]]


def test_a_missing_number_encloses_everything():
    found = bounded(lambda x: x.at[jnp.asarray([0, 9])].get(mode="fill"), Interval([1.0, 2.0], [1.0, 2.0]))
    assert ends(found.value) == [[1.0, -math.inf], [1.0, math.inf]]
    assert "an index is within its array" in found.undefined[0]
    assert ends(bound(lambda x: x.at[jnp.asarray([9])].get(mode="fill", fill_value=7.0), np.ones(2))) == [[7.0], [7.0]]
    assert ends(bound(lambda x: jnp.where(x > 0, x, jnp.nan), Interval(1.0, 2.0))) == [[1.0], [2.0]]
    assert ends(bound(lambda x: jnp.where(x > 0, x, jnp.nan), Interval(-1.0, 2.0))) == [[-math.inf], [math.inf]]


def test_arguments_and_results_are_pytrees():
    found = bound(
        lambda tree, k: {"sum": tree["a"] + tree["b"], "k": k}, {"a": Interval([1.0], [2.0]), "b": np.array([3.0])}, 2
    )
    assert ends(found["sum"]) == [[4.0], [5.0]]
    assert ends(found["k"]) == [[2.0], [2.0]]
    with pytest.raises(ValueError, match=r"bound.args: .*dtype <U1"):
        bound(lambda x: 1.0, "a")
    with pytest.raises(ValueError, match="complex"):
        bound(lambda x: x.real, 1j)


def test_a_program_is_traced_once_for_many_boxes():
    calls = []
    program = intervals.trace(lambda x: calls.append(0) or jnp.sin(x), Interval([0.0], [1.0]))
    assert [ends(program(Interval([a], [a + 0.5])).value)[0][0] for a in (0.0, 0.25)] == [0.0, pytest.approx(math.sin(0.25))]
    assert len(calls) == 1
    with pytest.raises(ValueError, match=r"Program.args: given shapes \[\(2,\)\]; expected shapes \[\(1,\)\]"):
        program(Interval([0.0, 1.0], [1.0, 2.0]))


def test_precision_is_float64_whatever_the_flag_and_the_leaves():
    with jax.enable_x64(False):
        found = bound(lambda x: jnp.sin(x) / 3, Interval(1.0, 1.0))
        assert jnp.asarray(1.0).dtype == jnp.float32
    assert found.width < 1e-15
    narrow = jaxobs.astype(plants.Pendulum(0.1), jnp.float32)
    found = bound(lambda x, u: narrow.phi(x, u), intervals.point([0.5, 0.0]), np.zeros(1))
    assert found.width < 1e-15
    assert found.contains(float(np.float32(0.1)) * math.sin(0.5))


def test_scan_is_its_steps_in_turn():
    step = lambda c, w: (jnp.sin(c) + w, c * w)  # noqa: E731
    weights = jnp.asarray([0.5, -1.0, 2.0])

    def unrolled(c):
        ys = []
        for i in range(3):
            c, y = step(c, weights[i])
            ys.append(y)
        return c, jnp.stack(ys)

    box = Interval([0.2, 1.0], [0.4, 1.5])
    for a, b in zip(bound(lambda c: jax.lax.scan(step, c, weights), box), bound(unrolled, box), strict=True):
        assert ends(a) == ends(b)
    none = bound(lambda c: jax.lax.scan(step, c, weights[:0]), box)
    assert ends(none[0]) == ends(box)
    assert none[1].shape == (0, 2)


A = np.random.default_rng(5).normal(size=(2, 3, 4))
K = np.array([[2, 0], [1, 2]])
FORMS = {
    "axes of reductions": lambda a: [jnp.sum(a, (0, 2)), jnp.max(a, 1), jnp.min(a, (1, 2)), jnp.prod(a, 0), jnp.mean(a)],
    "places of extremes": lambda a: [jnp.argmax(a, 1), jnp.argmin(a, 2), jnp.argmax(jnp.round(a), 2)],
    "sums along": lambda a: [jax.lax.cumsum(a, 1, reverse=True), jnp.cumprod(a, 2), jax.lax.cummax(a, 0), jax.lax.cummin(a, 2)],
    "batched products": lambda a: [jnp.einsum("ijk,ijl->ikl", a, a), jnp.einsum("ijk,klm->ijlm", a, jnp.moveaxis(a, 2, 0))],
    "vmapped products": lambda a: jax.vmap(lambda x, y: x @ y, in_axes=(0, 2), out_axes=1)(a, jnp.stack([a[0].T, a[1].T], 2)),
    "padding": lambda a: [jax.lax.pad(a, 0.5, ((1, -1, 2), (-1, 2, 0), (0, 0, 1))), jnp.pad(a, 1, mode="edge")],
    "reshapes": lambda a: jax.vmap(lambda x: x.reshape(4, 2), in_axes=1, out_axes=2)(a),
    "reshapes of other axes": lambda a: jax.vmap(jnp.ravel, in_axes=2)(a) + jax.vmap(jnp.ravel, in_axes=2, out_axes=1)(a).T,
    "orders": lambda a: [
        jnp.sort(a, 1),
        jnp.argsort(a, 2),
        jnp.sort(a, 0, descending=True),
        jnp.flip(a, (0, 2)),
        jnp.roll(a, 2, 2),
    ],
    "reading": lambda a: [a[:, jnp.asarray(K), :], a[0][jnp.asarray([2, 0]), jnp.asarray([1, 3])], jnp.take(a, -1, 1)],
    "reading outside": lambda a: [
        a.at[:, jnp.asarray([3, 0])].get(mode="fill", fill_value=-2.0),
        a.at[:, jnp.asarray([3, 0])].get(mode="clip"),
        a[:, 1:, ::2],
        a[..., ::-1],
    ],
    "vmapped reading": lambda a: jax.vmap(lambda x, k: jax.lax.dynamic_slice(x, (k[0], k[1]), (2, 2)), (0, 0))(
        a, jnp.asarray(K)
    ),
    "vmapped reading along": lambda a: jnp.take_along_axis(a, jnp.asarray([[[0, 2, 1, 1]], [[2, 0, 0, 1]]]), 1),
    "writing": lambda a: [a.at[:, 1].set(7.0), a.at[0, :, jnp.asarray([1, 1, 2])].add(a[1, :, :3].T), a.at[1].multiply(2.0)],
    "writing outside": lambda a: [
        a.at[:, jnp.asarray([0, 5])].set(1.0, mode="drop"),
        a.at[:, jnp.asarray([0, 5])].min(-3.0, mode="clip"),
        jax.lax.dynamic_update_slice(a, a[:1, :2], (jnp.asarray(1), jnp.asarray(2), jnp.asarray(-3))),
    ],
    "vmapped writing": lambda a: [
        jax.vmap(lambda x, k: x.at[k[0]].add(x[0]).at[:, k[1]].set(x[:, 0]), (1, 0), 1)(
            a[:, :2], jnp.asarray([[1, 0], [0, 2]])
        ),
        jax.vmap(lambda x, k: jax.lax.dynamic_update_slice(x, x[:1], (k[0], k[1])))(a, jnp.asarray(K)),
    ],
    "remainders": lambda a: [jnp.mod(a, -0.3), jnp.fmod(a, 0.3), a // 0.25, jnp.round(a * 2), jnp.trunc(a), jnp.sign(a)],
    "integers": lambda a: [
        (k := (a * 10).astype(int)) // 3,
        k % -4,
        jax.lax.div(k, k * 0 - 3),
        k >> 1,
        k & 6,
        k**2,
        ~k,
        abs(k),
    ],
    "rotated scan": lambda a: jax.lax.scan(lambda c, x: (c * x, c + x), a[0], a[:, ::-1], reverse=True),
    "nested branches": lambda a: jax.vmap(lambda x: jax.lax.cond(x[0, 0] > 0, jnp.sin, lambda y: y.T[::-1].T, x))(a),
    "vmapped scan": lambda a: jax.vmap(lambda x: jax.lax.scan(lambda c, y: (c + y, c * y), x[0], x), in_axes=1, out_axes=1)(a),
    "searching": lambda a: [jnp.interp(a, jnp.asarray([-1.0, 0.0, 2.0]), jnp.asarray([3.0, 1.0, 5.0])), jnp.clip(a, a[0], 0.5)],
    "norms": lambda a: [jnp.linalg.norm(a, axis=2), jnp.cross(a[..., :3], a[..., 1:]), jnp.trace(a[..., :3]), jnp.tril(a)],
}


@pytest.mark.parametrize("name", list(FORMS))
def test_at_single_numbers_every_form_of_a_primitive_is_that_of_jax(name: str):
    """Axes, orders, modes and batches: the enclosures of exact arguments are the values that JAX computes."""
    found, expected = jax.tree.leaves(bound(FORMS[name], A)), jax.tree.leaves(jax.jit(FORMS[name])(jnp.asarray(A)))
    assert len(found) == len(expected) > 0
    for x, value in zip(found, expected, strict=True):
        np.testing.assert_allclose(x.lower, value, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(x.upper, value, rtol=1e-12, atol=1e-12)
