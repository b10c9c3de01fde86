"""C99: one line a number, functions of math.h, no undefined behaviour for any input."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxobs.export.lines import Assign, Loop
from jaxobs.export.writing import AbstractLanguage

TYPES = {"float64": "double", "float32": "float", "int32": "int32_t", "int64": "int64_t", "uint32": "uint32_t", "bool": "int"}
INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
TRUTH = {"and": "&&", "or": "||", "xor": "!=", "eq": "==", "ne": "!="}
MATH = {
    "abs": "fabs", "erf": "erf", "round_away": "round", "round_even": "rint", "ceil": "ceil", "floor": "floor", "rem": "fmod",
    "lgamma": "lgamma", "pow": "pow", "sqrt": "sqrt", "cbrt": "cbrt", "exp": "exp", "exp2": "exp2", "expm1": "expm1",
    "log": "log", "log1p": "log1p", "sin": "sin", "cos": "cos", "tan": "tan", "asin": "asin", "acos": "acos", "atan": "atan",
    "atan2": "atan2", "sinh": "sinh", "cosh": "cosh", "tanh": "tanh", "asinh": "asinh", "acosh": "acosh", "atanh": "atanh",
    "erfc": "erfc",
}  # fmt: skip
_ROUNDED = """static int{bits}_t {name}(real a)
{{
    /* towards zero; NaN is 0, what does not fit is the nearest that does */
    if (a != a) return 0;
    if (a <= (real)-{limit}) return INT{bits}_MIN;
    return a >= (real){limit} ? INT{bits}_MAX : (int{bits}_t)a;
}}"""
HELPERS = {  # static functions, written where they are used
    "larger": "static real larger(real a, real b) { return a != a || a > b ? a : b; } /* NaN if one is */",
    "smaller": "static real smaller(real a, real b) { return a != a || a < b ? a : b; } /* NaN if one is */",
    "sign": "static real sign(real a) { return a > 0 ? 1 : a < 0 ? -1 : a; }",
    "whole": _ROUNDED.format(name="whole", bits=32, limit="2147483648.0"),
    "whole64": _ROUNDED.format(name="whole64", bits=64, limit="9223372036854775808.0"),
}


class C(AbstractLanguage):
    """Numbers of type `real` (float or double)."""

    def __init__(self, real: np.dtype):
        self.real = real
        self.helpers: set[str] = set()
        self.loops = 0

    def number(self, value: Any) -> str:
        if isinstance(value, np.bool_):
            return str(int(value))
        if isinstance(value, np.integer):
            made = f"{value.dtype.name.upper()}_C"  # INT32_C and its like, of stdint.h
            return f"{made}({int(value)})" if value >= 0 else f"(-{made}({-int(value) - 1}) - 1)"
        return literal(value)

    def type(self, dtype: np.dtype) -> str:
        return "real" if dtype == self.real else TYPES[dtype.name]

    def pattern(self, line: Assign) -> tuple[str, bool]:
        op, given = line.op, line.given
        if op == "select":
            return "{0} ? {2} : {1}", True
        if op == "is_finite":
            return "isfinite({0})", False
        if op == "convert":
            return self._convert(line)
        if given.kind == "b":
            return ("!{0}", True) if op == "not" else (f"{{0}} {TRUTH[op]} {{1}}", True)
        if given.kind in "iu":
            return self._whole(line)
        if op in INFIX:
            return f"{{0}} {INFIX[op]} {{1}}", True
        if op == "neg":
            return "-{0}", True
        if op in ("max", "min", "sign"):
            return self._helper({"max": "larger", "min": "smaller", "sign": "sign"}[op], 1 if op == "sign" else 2), False
        name = MATH[op] + ("f" if given == np.float32 else "")
        return f"{name}({', '.join(f'{{{i}}}' for i in range(len(line.operands)))})", False

    def _helper(self, name: str, count: int) -> str:
        self.helpers.add(name)
        return f"{name}({', '.join(f'{{{i}}}' for i in range(count))})"

    def _convert(self, line: Assign) -> tuple[str, bool]:
        to = line.dtype
        if to.kind == "b":
            return "{0} != 0", True
        if to.kind in "iu" and line.given.kind == "f":
            return self._helper("whole64" if to.itemsize == 8 else "whole", 1), False
        return f"({self.type(to)}){{0}}", True

    def _whole(self, line: Assign) -> tuple[str, bool]:
        """Whole numbers wrap around, as JAX's do: sums through the type without a sign."""
        op, name = line.op, TYPES[line.given.name]
        wide = "uint64_t" if line.given.itemsize == 8 else "uint32_t"
        if op in ("add", "sub", "mul"):
            return f"({name})(({wide}){{0}} {INFIX[op]} ({wide}){{1}})", True
        if op == "neg":
            return f"({name})(0 - ({wide}){{0}})", True
        if op == "abs":
            return f"{{0}} < 0 ? ({name})(0 - ({wide}){{0}}) : {{0}}", True
        if op in ("max", "min"):
            return f"{{0}} {'>' if op == 'max' else '<'} {{1}} ? {{0}} : {{1}}", True
        return f"{{0}} {INFIX[op]} {{1}}", True

    def define(self, name: str, dtype: np.dtype, text: str) -> str:
        return f"const {self.type(dtype)} {name} = {text};"

    def loop(
        self, loop: Loop, names: Sequence[str], starts: Sequence[str], body: Sequence[str], aheads: Sequence[str]
    ) -> list[str]:
        self.loops += 1
        kinds = [self.type(one.dtype) for one in loop.carried]
        each, count = list(zip(kinds, names, starts, aheads, strict=True)), f"turn{self.loops}"
        text = [f"{kind} {name} = {start};" for kind, name, start, _ in each]
        text += [f"for (int {count} = 0; {count} < {loop.length}; ++{count}) {{", *(self.tab + line for line in body)]
        text += [f"{self.tab}const {kind} {name}_next = {ahead};" for kind, name, _, ahead in each]
        text += [f"{self.tab}{name} = {name}_next;" for name in names]
        return [*text, "}"]


def literal(value: Any) -> str:
    """The shortest decimal that is read back as the same float, with the suffix of its type."""
    single = value.dtype == np.float32
    if not np.isfinite(value):
        text = "NAN" if np.isnan(value) else "INFINITY"
        return f"({'-' if value < 0 else ''}(real){text})"
    plain = value == 0 or 1e-4 <= abs(value) < 1e7
    text = (str(value) if plain else np.format_float_scientific(value, trim="0")) + ("f" if single else "")
    return f"({text})" if np.signbit(value) else text
