"""A jaxpr evaluated at a point with 128-bit balls of python-flint's arb: the reference for enclosures.

Real numbers are NumPy object arrays of balls, integers and truth values are NumPy arrays. Where each number is read from or
written to (gather, scatter) is asked of JAX itself, with positions in place of numbers.
"""

import functools

import flint
import jax
import jax.numpy as jnp
import numpy as np
from flint import arb

from tests.oracles import ball_numbers as number
from tests.oracles.ball_places import read_from, scatter, scatter_with, update_slice


def balls(values):
    """Exact balls of an array of floats; balls stay."""
    array = np.asarray(values)
    return array if array.dtype == object else _each(arb)(array.astype(np.float64).astype(object))


def evaluate(closed, *args):
    """The outputs of a closed jaxpr: object arrays of balls, or arrays of integers and truth values."""
    with flint.ctx.workprec(number.BITS):
        return _run(closed.jaxpr, [_read(c) for c in closed.consts], [_read(a) for a in args])


def _each(function):
    """A function of numbers on object arrays; the result is an array even where it has no axes."""
    ufunc = np.frompyfunc(function, function.__code__.co_argcount if hasattr(function, "__code__") else 1, 1)
    return lambda *a: np.asarray(ufunc(*a), dtype=object)


def _read(value):
    array = np.asarray(value)
    return balls(array) if array.dtype.kind == "f" else array


def _run(jaxpr, consts, args):
    known = dict(zip(jaxpr.constvars, consts, strict=True)) | dict(zip(jaxpr.invars, args, strict=True))

    def value(v):
        return _read(v.val) if hasattr(v, "val") else known[v]

    for eqn in jaxpr.eqns:
        given = [value(v) for v in eqn.invars]
        results = PRIMITIVES[eqn.primitive.name](eqn, *given)
        results = results if isinstance(results, (list, tuple)) else [results]
        known.update(zip(eqn.outvars, results, strict=True))
    return [value(v) for v in jaxpr.outvars]


def _inner(eqn, *args):
    jaxpr = next(eqn.params[k] for k in ("jaxpr", "call_jaxpr", "fun_jaxpr") if k in eqn.params)
    return _run(getattr(jaxpr, "jaxpr", jaxpr), [_read(c) for c in getattr(jaxpr, "consts", ())], args)


def _truths(function):
    ufunc = np.frompyfunc(function, 2, 1)
    return lambda eqn, a, b: np.asarray(ufunc(a, b)).astype(bool)


def _native(eqn, function, *args):
    """Integers and truth values by NumPy in their own type."""
    with np.errstate(all="ignore"):
        return np.asarray(function(*args)).astype(eqn.outvars[0].aval.dtype)


def _on_bits(function, eqn, a, b):
    return _native(eqn, function, a, b)


def _binary(real, native):
    each = _each(real)
    return lambda eqn, a, b: each(a, b) if np.asarray(a).dtype == object else _native(eqn, native, a, b)


def _unary(real, native=None):
    each = _each(real)
    return lambda eqn, a: each(a) if np.asarray(a).dtype == object else _native(eqn, native, a)


def _integer_pow(eqn, x):
    n = eqn.params["y"]
    if x.dtype != object:
        return _native(eqn, lambda z: z**n, x)
    return _each(lambda z: z**n if n >= 0 else number.quotient(arb(1), z**-n))(x)


def _convert(eqn, x):
    dtype = np.dtype(eqn.params["new_dtype"])
    if dtype.kind == "f":
        return x if x.dtype == object else balls(x)
    if x.dtype == object:
        return _each(lambda z: int(float(z)))(x).astype(dtype) if dtype.kind != "b" else _each(lambda z: z != 0)(x).astype(bool)
    return x.astype(dtype)


def _select_n(eqn, which, *cases):
    which = np.broadcast_to(np.asarray(which).astype(int), cases[0].shape)
    found = cases[0]
    for i, case in enumerate(cases):
        found = np.where(which == i, case, found)
    return np.asarray(found, dtype=cases[0].dtype)


def _shape(eqn):
    return eqn.outvars[0].aval.shape


def _broadcast(eqn, x):
    shape = [1] * len(_shape(eqn))
    for size, axis in zip(x.shape, eqn.params["broadcast_dimensions"], strict=True):
        shape[axis] = size
    return np.broadcast_to(x.reshape(shape), _shape(eqn))


def _slice(eqn, x):
    p = eqn.params
    strides = p["strides"] or [1] * x.ndim
    return x[tuple(map(slice, p["start_indices"], p["limit_indices"], strides))]


def _reduced(function, native=None):
    def apply(eqn, x):
        native_function = function if x.dtype == object or native is None else native
        for axis in sorted(map(int, eqn.params["axes"]), reverse=True):
            x = native_function(x, axis)
        return np.asarray(x, dtype=object) if x.dtype == object else x

    return apply


def _fold(pair):
    ufunc = np.frompyfunc(pair, 2, 1)

    def along(x, axis):
        return functools.reduce(ufunc, list(np.moveaxis(x, axis, 0)))

    return lambda x, axis: np.asarray(along(x, axis))


def _cumulative(pair):
    ufunc = np.frompyfunc(pair, 2, 1)

    def apply(eqn, x):
        axis, back = eqn.params["axis"], eqn.params["reverse"]
        parts = list(np.moveaxis(x, axis, 0))[:: -1 if back else 1]
        for i in range(1, len(parts)):
            parts[i] = ufunc(parts[i - 1], parts[i])
        return np.stack(parts[:: -1 if back else 1], axis)

    return apply


def _dot(eqn, x, y):
    (cx, cy), (bx, by) = eqn.params["dimension_numbers"]
    letters = iter("abcdefghijklmnop")
    name_x, name_y = [""] * x.ndim, [""] * y.ndim
    for i, j in [*zip(bx, by, strict=True), *zip(cx, cy, strict=True)]:
        name_x[i] = name_y[j] = next(letters)
    name_x, name_y = ([n or next(letters) for n in names] for names in (name_x, name_y))
    out = [name_x[i] for i in bx]
    out += [name_x[i] for i in range(x.ndim) if i not in (*bx, *cx)] + [name_y[i] for i in range(y.ndim) if i not in (*by, *cy)]
    return np.asarray(np.einsum(f"{''.join(name_x)},{''.join(name_y)}->{''.join(out)}", x, y))


def _pad(eqn, x, value):
    positions = np.asarray(jax.lax.pad(jnp.arange(1, x.size + 1).reshape(x.shape), 0, eqn.params["padding_config"]))
    return np.append(np.asarray([value.item()], dtype=x.dtype), x.ravel())[positions]


def _scan(eqn, *args):
    p = eqn.params
    consts, carry = args[: p["num_consts"]], list(args[p["num_consts"] : p["num_consts"] + p["num_carry"]])
    xs, ys = args[p["num_consts"] + p["num_carry"] :], []
    for i in range(p["length"])[:: -1 if p["reverse"] else 1]:
        out = _run(p["jaxpr"].jaxpr, [_read(c) for c in p["jaxpr"].consts], [*consts, *carry, *[np.asarray(x[i]) for x in xs]])
        carry, y = out[: p["num_carry"]], out[p["num_carry"] :]
        ys.append(y)
    return [*carry, *[np.stack(each) for each in zip(*ys[:: -1 if p["reverse"] else 1], strict=True)]]


def _while(eqn, *args):
    p, c, b = eqn.params, eqn.params["cond_nconsts"], eqn.params["body_nconsts"]
    state = list(args[c + b :])
    while _run(p["cond_jaxpr"].jaxpr, [_read(k) for k in p["cond_jaxpr"].consts], [*args[:c], *state])[0]:
        state = _run(p["body_jaxpr"].jaxpr, [_read(k) for k in p["body_jaxpr"].consts], [*args[c : c + b], *state])
    return state


def _cond(eqn, which, *args):
    branch = eqn.params["branches"][int(np.clip(int(which), 0, len(eqn.params["branches"]) - 1))]
    return _run(branch.jaxpr, [_read(c) for c in branch.consts], args)


def _sort(eqn, key, *others):
    axis = eqn.params["dimension"]
    keys = np.moveaxis(key, axis, -1)
    compare = functools.cmp_to_key(lambda a, b: -1 if number.before(a[0], b[0]) else 0 if number.same(a[0], b[0]) else 1)
    rows = keys.reshape(-1, keys.shape[-1])
    orders = [[i for _, i in sorted(zip(row, range(len(row)), strict=True), key=compare)] for row in rows]
    order = np.moveaxis(np.asarray(orders).reshape(keys.shape), -1, axis)
    return [np.take_along_axis(x, order, axis) for x in (key, *others)]


def _arg(better):
    def apply(eqn, x):
        (axis,) = map(int, eqn.params["axes"])
        rows = np.moveaxis(x, axis, -1)
        first = [functools.reduce(lambda i, j, r=row: j if better(r[j], r[i]) else i, range(len(row)))
                 for row in rows.reshape(-1, rows.shape[-1])]  # fmt: skip
        return np.asarray(first).reshape(rows.shape[:-1])

    return apply


BITWISE = {
    **{"and": np.bitwise_and, "or": np.bitwise_or, "xor": np.bitwise_xor},
    **{"shift_left": np.left_shift, "shift_right_arithmetic": np.right_shift},
}
PRIMITIVES = {
    **dict.fromkeys(["jit", "closed_call", "remat2", "checkpoint", "custom_jvp_call", "custom_vjp_call"], _inner),
    **dict.fromkeys(["stop_gradient", "copy", "name", "optimization_barrier", "reduce_precision"], lambda eqn, *a: list(a)),
    **dict.fromkeys(["add", "add_any"], _binary(lambda a, b: a + b, np.add)),
    "sub": _binary(lambda a, b: a - b, np.subtract),
    "mul": _binary(lambda a, b: a * b, np.multiply),
    "div": _binary(number.quotient, number.towards_zero),
    "rem": _binary(number.remainder, np.fmod),
    "neg": _unary(lambda a: -a, np.negative),
    "abs": _unary(lambda a: abs(a), np.abs),
    "sign": _unary(number.sign, np.sign),
    "square": _unary(lambda a: a * a, np.square),
    "floor": _unary(number.whole(lambda x: x.floor())),
    "ceil": _unary(number.whole(lambda x: x.ceil())),
    "round": lambda eqn, x: _each(number.half_even if int(eqn.params["rounding_method"]) == 1 else number.half_away)(x),
    "integer_pow": _integer_pow,
    "pow": _binary(number.power, np.power),
    **{name: _unary(f) for name, f in number.FUNCTIONS.items()},
    "atan2": _binary(lambda y, x: arb.atan2(y, x), None),
    "max": _binary(number.greater, np.maximum),
    "min": _binary(number.lesser, np.minimum),
    "clamp": lambda eqn, low, x, high: _each(lambda a, b, c: number.lesser(number.greater(b, a), c))(low, x, high)
    if x.dtype == object else _native(eqn, lambda a, b, c: np.minimum(np.maximum(b, a), c), low, x, high),
    **dict.fromkeys(["lt", "lt_to"], _truths(lambda a, b: number.before(a, b))),
    "gt": _truths(lambda a, b: number.before(b, a)),
    **dict.fromkeys(["le", "le_to"], _truths(lambda a, b: not number.before(b, a))),
    "ge": _truths(lambda a, b: not number.before(a, b)),
    "eq": _truths(number.same),
    "ne": _truths(lambda a, b: not number.same(a, b)),
    "is_finite": lambda eqn, x: np.ones(x.shape, dtype=bool),
    **{name: functools.partial(_on_bits, function) for name, function in BITWISE.items()},
    "not": lambda eqn, a: _native(eqn, np.invert, a),
    "shift_right_logical": lambda eqn, a, b: np.asarray(eqn.primitive.bind(jnp.asarray(a), jnp.asarray(b))),
    "unstack": lambda eqn, x: [np.asarray(y) for y in np.moveaxis(x, eqn.params["axis"], 0)],
    "select_n": _select_n,
    "convert_element_type": _convert,
    "squeeze": lambda eqn, x: x.reshape(_shape(eqn)),
    "reshape": lambda eqn, x: np.transpose(x, eqn.params["dimensions"]).reshape(_shape(eqn))
    if eqn.params["dimensions"] is not None else x.reshape(_shape(eqn)),
    "transpose": lambda eqn, x: np.transpose(x, eqn.params["permutation"]),
    "broadcast_in_dim": _broadcast,
    "slice": _slice,
    "split": lambda eqn, x: np.split(x, np.cumsum(eqn.params["sizes"])[:-1], eqn.params["axis"]),
    "concatenate": lambda eqn, *a: np.concatenate(a, eqn.params["dimension"]),
    "stack": lambda eqn, *a: np.stack(a, eqn.params["axis"]),
    "tile": lambda eqn, x: np.tile(x, eqn.params["reps"]),
    "rev": lambda eqn, x: np.flip(x, eqn.params["dimensions"]),
    "iota": lambda eqn: _read(np.indices(_shape(eqn))[eqn.params["dimension"]].astype(eqn.params["dtype"])),
    "pad": _pad,
    "sort": _sort,
    "reduce_sum": _reduced(_fold(lambda a, b: a + b), lambda x, axis: np.sum(x, axis)),
    "reduce_prod": _reduced(_fold(lambda a, b: a * b), lambda x, axis: np.prod(x, axis)),
    "reduce_max": _reduced(_fold(number.greater), lambda x, axis: np.max(x, axis)),
    "reduce_min": _reduced(_fold(number.lesser), lambda x, axis: np.min(x, axis)),
    "reduce_and": _reduced(lambda x, axis: np.all(x, axis)),
    "reduce_or": _reduced(lambda x, axis: np.any(x, axis)),
    "argmax": _arg(lambda a, b: number.before(b, a)),
    "argmin": _arg(number.before),
    "cumsum": _cumulative(lambda a, b: a + b),
    "cumprod": _cumulative(lambda a, b: a * b),
    "cummax": _cumulative(number.greater),
    "cummin": _cumulative(number.lesser),
    "dot_general": _dot,
    "gather": read_from,
    "dynamic_slice": read_from,
    "dynamic_update_slice": update_slice,
    "scatter": scatter,
    "scatter-add": scatter_with(lambda a, b: a + b),
    "scatter-sub": scatter_with(lambda a, b: a - b),
    "scatter-mul": scatter_with(lambda a, b: a * b),
    "scatter-max": scatter_with(number.greater),
    "scatter-min": scatter_with(number.lesser),
    "scan": _scan,
    "while": _while,
    "cond": _cond,
}  # fmt: skip
