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

BITS = 128


class AmbiguousError(ArithmeticError):
    """Two balls overlap, so that their comparison is not known."""


def balls(values):
    """Exact balls of an array of floats; balls stay."""
    array = np.asarray(values)
    return array if array.dtype == object else _each(arb)(array.astype(np.float64).astype(object))


def evaluate(closed, *args):
    """The outputs of a closed jaxpr: object arrays of balls, or arrays of integers and truth values."""
    with flint.ctx.workprec(BITS):
        return _run(closed.jaxpr, [_read(c) for c in closed.consts], [_read(a) for a in args])


def disjoint(ball, lower, upper):
    """Whether each ball, if it is finite, lies entirely outside [lower, upper]; and the number of finite ones."""
    with flint.ctx.workprec(BITS):
        pairs = [(b, lo, up) for b, lo, up in zip(ball.ravel(), lower.ravel(), upper.ravel(), strict=True) if b.is_finite()]
        return sum(bool(b < arb(lo)) or bool(b > arb(up)) for b, lo, up in pairs), len(pairs)


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


def _before(a, b):
    """a < b of two numbers."""
    if a is b:
        return False
    if a < b:
        return True
    if a >= b:
        return False
    raise AmbiguousError(f"{a} < {b}")


def _same(a, b):
    if a is b:
        return True
    if a < b or a > b:
        return False
    if a == b:
        return True
    raise AmbiguousError(f"{a} == {b}")


def _truths(function):
    ufunc = np.frompyfunc(function, 2, 1)
    return lambda eqn, a, b: np.asarray(ufunc(a, b)).astype(bool)


def _native(eqn, function, *args):
    """Integers and truth values by NumPy in their own type."""
    with np.errstate(all="ignore"):
        return np.asarray(function(*args)).astype(eqn.outvars[0].aval.dtype)


def _binary(real, native):
    each = _each(real)
    return lambda eqn, a, b: each(a, b) if np.asarray(a).dtype == object else _native(eqn, native, a, b)


def _unary(real, native=None):
    each = _each(real)
    return lambda eqn, a: each(a) if np.asarray(a).dtype == object else _native(eqn, native, a)


def _quotient(a, b):
    return arb("nan") if b.contains(0) else a / b


def _towards_zero(a, b):
    return np.trunc(np.asarray(a, dtype=np.float64) / np.asarray(b, dtype=np.float64))


def _whole(function):
    def step(x):
        result = function(x)
        if not result.is_exact():
            raise AmbiguousError(str(x))
        return result

    return step


def _sign(x):
    return arb(0) if x == 0 else arb(-1) if _before(x, arb(0)) else arb(1)


def _remainder(a, b):
    turns = a / b
    return a - b * (_whole(lambda x: x.floor())(turns) if not _before(turns, arb(0)) else _whole(lambda x: x.ceil())(turns))


def _half_even(x):
    low = _whole(lambda z: z.floor())(x)
    rest = x - low - arb(1) / 2
    up = (not _before(rest, arb(0))) if rest != 0 else (int(low.unique_fmpz()) % 2 == 1)
    return low + 1 if up else low


def _half_away(x):
    return -_half_away(-x) if _before(x, arb(0)) else _whole(lambda z: z.floor())(x + arb(1) / 2)


def _power(x, y):
    if y.is_exact() and y.is_integer():
        return arb(1) if y == 0 else _quotient(arb(1), x ** int(-y.unique_fmpz())) if y < 0 else x ** int(y.unique_fmpz())
    return x**y


def _integer_pow(eqn, x):
    n = eqn.params["y"]
    if x.dtype != object:
        return _native(eqn, lambda z: z**n, x)
    return _each(lambda z: z**n if n >= 0 else _quotient(arb(1), z**-n))(x)


def _logistic(x):
    return 1 / (1 + (-x).exp())


def _cbrt(x):
    return x.root(3) if x >= 0 else -((-x).root(3))


def _convert(eqn, x):
    dtype = np.dtype(eqn.params["new_dtype"])
    if dtype.kind == "f":
        return x if x.dtype == object else balls(x)
    if x.dtype == object:
        return _each(lambda z: int(float(z)))(x).astype(dtype) if dtype.kind != "b" else _each(lambda z: z != 0)(x).astype(bool)
    return x.astype(dtype)


def _select_n(eqn, which, *cases):
    which = np.broadcast_to(np.asarray(which).astype(int), cases[0].shape)
    return np.choose(which, cases) if cases[0].dtype != object else _chosen(which, cases)


def _chosen(which, cases):
    found = cases[0].copy()
    for i, case in enumerate(cases):
        found = np.where(which == i, case, found)
    return np.asarray(found, dtype=object)


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


def _greater(a, b):
    return b if _before(a, b) else a


def _lesser(a, b):
    return b if _before(b, a) else a


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


def _places(eqn, shape, *index):
    """For each number of the result, the place in the operand it was read from, plus 1; 0 for none."""
    places = jnp.arange(1, 1 + int(np.prod(shape))).reshape(shape)
    params = dict(eqn.params)
    if "fill_value" in params:
        params["fill_value"] = 0
    return np.asarray(eqn.primitive.bind(places, *map(jnp.asarray, index), **params))


def _read_from(eqn, x, *index):
    at = _places(eqn, x.shape, *index)
    flat = np.append(np.asarray([arb("nan")] if x.dtype == object else [0]), x.ravel())
    return flat[at] if x.dtype != object else np.asarray(flat.astype(object)[at], dtype=object)


def _scatter(eqn, x, index, update):
    if update.dtype != object:
        return np.asarray(eqn.primitive.bind(jnp.asarray(x), jnp.asarray(index), jnp.asarray(update), **eqn.params))
    n = x.size
    old, new = jnp.arange(n).reshape(x.shape), jnp.arange(n, n + update.size).reshape(update.shape)
    at = np.asarray(eqn.primitive.bind(old, jnp.asarray(index), new, **eqn.params))
    return np.asarray(np.append(x.ravel(), update.ravel())[at], dtype=object)


def _scatter_with(pair):
    """Where each update goes is the gradient of the scattered sum of all, weighted by place."""

    def apply(eqn, x, index, update):
        if update.dtype != object:
            return np.asarray(eqn.primitive.bind(jnp.asarray(x), jnp.asarray(index), jnp.asarray(update), **eqn.params))
        params = {k: eqn.params[k] for k in ("dimension_numbers", "indices_are_sorted", "unique_indices", "mode")}
        place = jnp.arange(1.0, x.size + 1, dtype=jnp.float64).reshape(x.shape)

        def put(values):
            zero = jnp.zeros(x.shape, jnp.float64)
            p = dict(params)
            return jax.lax.scatter_add(zero, jnp.asarray(index), values, p.pop("dimension_numbers"), **p)

        _, back = jax.vjp(put, jnp.zeros(update.shape, jnp.float64))
        found = x.ravel().copy()
        for at, number in zip(np.asarray(back(place)[0]).astype(int).ravel(), update.ravel(), strict=True):
            if at:
                found[at - 1] = pair(found[at - 1], number)
        return found.reshape(x.shape)

    return apply


def _update(eqn, x, update, *starts):
    at = tuple(slice(s, s + n) for s, n in zip(
        [int(np.clip(int(s), 0, n - m)) for s, n, m in zip(starts, x.shape, update.shape, strict=True)], update.shape, strict=True))  # fmt: skip
    x = x.copy()
    x[at] = update
    return x


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
    compare = functools.cmp_to_key(lambda a, b: -1 if _before(a[0], b[0]) else 0 if _same(a[0], b[0]) else 1)
    orders = [[i for _, i in sorted(zip(row, range(len(row)), strict=True), key=compare)] for row in keys.reshape(-1, keys.shape[-1])]
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


def _iota(eqn):
    return _read(np.asarray(jax.lax.iota_p.bind(**eqn.params)))


PRIMITIVES = {
    **dict.fromkeys(["jit", "closed_call", "remat2", "checkpoint", "custom_jvp_call", "custom_vjp_call"], _inner),
    **dict.fromkeys(["stop_gradient", "copy", "optimization_barrier", "reduce_precision"], lambda eqn, *a: list(a)),
    **dict.fromkeys(["add", "add_any"], _binary(lambda a, b: a + b, np.add)),
    "sub": _binary(lambda a, b: a - b, np.subtract),
    "mul": _binary(lambda a, b: a * b, np.multiply),
    "div": _binary(_quotient, _towards_zero),
    "rem": _binary(_remainder, np.fmod),
    "neg": _unary(lambda a: -a, np.negative),
    "abs": _unary(lambda a: abs(a), np.abs),
    "sign": _unary(_sign, np.sign),
    "square": _unary(lambda a: a * a, np.square),
    "floor": _unary(_whole(lambda x: x.floor())),
    "ceil": _unary(_whole(lambda x: x.ceil())),
    "round": lambda eqn, x: _each(_half_even if int(eqn.params["rounding_method"]) == 1 else _half_away)(x),
    "integer_pow": _integer_pow,
    "pow": _binary(_power, np.power),
    "sqrt": _unary(lambda a: a.sqrt()),
    "rsqrt": _unary(lambda a: a.rsqrt()),
    "cbrt": _unary(_cbrt),
    "exp": _unary(lambda a: a.exp()),
    "exp2": _unary(lambda a: arb(2) ** a),
    "expm1": _unary(lambda a: a.expm1()),
    "log": _unary(lambda a: a.log()),
    "log1p": _unary(lambda a: a.log1p()),
    "sin": _unary(lambda a: a.sin()),
    "cos": _unary(lambda a: a.cos()),
    "tan": _unary(lambda a: a.tan()),
    "sinh": _unary(lambda a: a.sinh()),
    "cosh": _unary(lambda a: a.cosh()),
    "tanh": _unary(lambda a: a.tanh()),
    "asin": _unary(lambda a: a.asin()),
    "acos": _unary(lambda a: a.acos()),
    "atan": _unary(lambda a: a.atan()),
    "asinh": _unary(lambda a: a.asinh()),
    "acosh": _unary(lambda a: a.acosh()),
    "atanh": _unary(lambda a: a.atanh()),
    "erf": _unary(lambda a: a.erf()),
    "erfc": _unary(lambda a: a.erfc()),
    "erf_inv": _unary(lambda a: a.erfinv()),
    "logistic": _unary(_logistic),
    "atan2": _binary(lambda y, x: arb.atan2(y, x), None),
    "max": _binary(_greater, np.maximum),
    "min": _binary(_lesser, np.minimum),
    "clamp": lambda eqn, low, x, high: _each(lambda a, b, c: _lesser(_greater(b, a), c))(low, x, high)
    if x.dtype == object else _native(eqn, lambda a, b, c: np.minimum(np.maximum(b, a), c), low, x, high),
    "lt": _truths(lambda a, b: _before(a, b)),
    "gt": _truths(lambda a, b: _before(b, a)),
    "le": _truths(lambda a, b: not _before(b, a)),
    "ge": _truths(lambda a, b: not _before(a, b)),
    "eq": _truths(_same),
    "ne": _truths(lambda a, b: not _same(a, b)),
    "is_finite": lambda eqn, x: np.ones(x.shape, dtype=bool),
    "and": lambda eqn, a, b: _native(eqn, np.bitwise_and, a, b),
    "or": lambda eqn, a, b: _native(eqn, np.bitwise_or, a, b),
    "xor": lambda eqn, a, b: _native(eqn, np.bitwise_xor, a, b),
    "not": lambda eqn, a: _native(eqn, np.invert, a),
    "shift_left": lambda eqn, a, b: _native(eqn, np.left_shift, a, b),
    "shift_right_arithmetic": lambda eqn, a, b: _native(eqn, np.right_shift, a, b),
    "shift_right_logical": lambda eqn, a, b: np.asarray(eqn.primitive.bind(jnp.asarray(a), jnp.asarray(b))),
    "unstack": lambda eqn, x: [np.asarray(y) for y in np.moveaxis(x, eqn.params["axis"], 0)],
    "select_n": _select_n,
    "convert_element_type": _convert,
    "reshape": lambda eqn, x: x.reshape(_shape(eqn)),
    "squeeze": lambda eqn, x: x.reshape(_shape(eqn)),
    "expand_dims": lambda eqn, x: x.reshape(_shape(eqn)),
    "transpose": lambda eqn, x: np.transpose(x, eqn.params["permutation"]),
    "broadcast_in_dim": _broadcast,
    "slice": _slice,
    "split": lambda eqn, x: np.split(x, np.cumsum(eqn.params["sizes"])[:-1], eqn.params["axis"]),
    "concatenate": lambda eqn, *a: np.concatenate(a, eqn.params["dimension"]),
    "stack": lambda eqn, *a: np.stack(a, eqn.params["axis"]),
    "tile": lambda eqn, x: np.tile(x, eqn.params["reps"]),
    "rev": lambda eqn, x: np.flip(x, eqn.params["dimensions"]),
    "iota": _iota,
    "pad": _pad,
    "sort": _sort,
    "reduce_sum": _reduced(_fold(lambda a, b: a + b), lambda x, axis: np.sum(x, axis)),
    "reduce_prod": _reduced(_fold(lambda a, b: a * b), lambda x, axis: np.prod(x, axis)),
    "reduce_max": _reduced(_fold(_greater), lambda x, axis: np.max(x, axis)),
    "reduce_min": _reduced(_fold(_lesser), lambda x, axis: np.min(x, axis)),
    "reduce_and": _reduced(lambda x, axis: np.all(x, axis)),
    "reduce_or": _reduced(lambda x, axis: np.any(x, axis)),
    "argmax": _arg(lambda a, b: _before(b, a)),
    "argmin": _arg(_before),
    "cumsum": _cumulative(lambda a, b: a + b),
    "cumprod": _cumulative(lambda a, b: a * b),
    "cummax": _cumulative(_greater),
    "cummin": _cumulative(_lesser),
    "dot_general": _dot,
    "gather": _read_from,
    "dynamic_slice": _read_from,
    "dynamic_update_slice": _update,
    "scatter": _scatter,
    "scatter-add": _scatter_with(lambda a, b: a + b),
    "scatter-sub": _scatter_with(lambda a, b: a - b),
    "scatter-mul": _scatter_with(lambda a, b: a * b),
    "scatter-max": _scatter_with(_greater),
    "scatter-min": _scatter_with(_lesser),
    "scan": _scan,
    "while": _while,
    "cond": _cond,
}  # fmt: skip
