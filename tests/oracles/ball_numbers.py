"""Numbers as balls of python-flint's arb: comparisons that refuse to guess, and functions of one or two numbers."""

import flint
import numpy as np
from flint import arb

BITS = 128


class AmbiguousError(ArithmeticError):
    """Two balls overlap, so that their comparison is not known."""


def before(a, b):
    """a < b of two numbers."""
    if a is b:
        return False
    if a < b:
        return True
    if a >= b:
        return False
    raise AmbiguousError(f"{a} < {b}")


def same(a, b):
    if a is b:
        return True
    if a < b or a > b:
        return False
    if a == b:
        return True
    raise AmbiguousError(f"{a} == {b}")


def quotient(a, b):
    return arb("nan") if b.contains(0) else a / b


def towards_zero(a, b):
    return np.trunc(np.asarray(a, dtype=np.float64) / np.asarray(b, dtype=np.float64))


def whole(function):
    def step(x):
        result = function(x)
        if not result.is_exact():
            raise AmbiguousError(str(x))
        return result

    return step


def sign(x):
    return arb(0) if x == 0 else arb(-1) if before(x, arb(0)) else arb(1)


def remainder(a, b):
    turns = a / b
    return a - b * (whole(lambda x: x.floor())(turns) if not before(turns, arb(0)) else whole(lambda x: x.ceil())(turns))


def half_even(x):
    low = whole(lambda z: z.floor())(x)
    rest = x - low - arb(1) / 2
    up = (not before(rest, arb(0))) if rest != 0 else (int(low.unique_fmpz()) % 2 == 1)
    return low + 1 if up else low


def half_away(x):
    return -half_away(-x) if before(x, arb(0)) else whole(lambda z: z.floor())(x + arb(1) / 2)


def power(x, y):
    if y.is_exact() and y.is_integer():
        return arb(1) if y == 0 else quotient(arb(1), x ** int(-y.unique_fmpz())) if y < 0 else x ** int(y.unique_fmpz())
    return x**y


def logistic(x):
    return 1 / (1 + (-x).exp())


def cbrt(x):
    return x.root(3) if x >= 0 else -((-x).root(3))


def greater(a, b):
    return b if before(a, b) else a


def lesser(a, b):
    return b if before(b, a) else a


def disjoint(ball, lower, upper):
    """Whether each ball, if it is finite, lies entirely outside [lower, upper]; and the number of finite ones."""
    with flint.ctx.workprec(BITS):
        pairs = [(b, lo, up) for b, lo, up in zip(ball.ravel(), lower.ravel(), upper.ravel(), strict=True) if b.is_finite()]
        return sum(bool(b < arb(lo)) or bool(b > arb(up)) for b, lo, up in pairs), len(pairs)


FUNCTIONS = {
    "sqrt": lambda a: a.sqrt(),
    "rsqrt": lambda a: a.rsqrt(),
    "cbrt": cbrt,
    "exp": lambda a: a.exp(),
    "exp2": lambda a: arb(2) ** a,
    "expm1": lambda a: a.expm1(),
    "log": lambda a: a.log(),
    "log1p": lambda a: a.log1p(),
    "sin": lambda a: a.sin(),
    "cos": lambda a: a.cos(),
    "tan": lambda a: a.tan(),
    "sinh": lambda a: a.sinh(),
    "cosh": lambda a: a.cosh(),
    "tanh": lambda a: a.tanh(),
    "asin": lambda a: a.asin(),
    "acos": lambda a: a.acos(),
    "atan": lambda a: a.atan(),
    "asinh": lambda a: a.asinh(),
    "acosh": lambda a: a.acosh(),
    "atanh": lambda a: a.atanh(),
    "erf": lambda a: a.erf(),
    "erfc": lambda a: a.erfc(),
    "erf_inv": lambda a: a.erfinv(),
    "logistic": logistic,
}
