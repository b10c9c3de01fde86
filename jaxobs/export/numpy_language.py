"""NumPy: the same lines on scalars of one precision."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxobs.export.lines import Assign, Loop
from jaxobs.export.writing import AbstractLanguage

INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
TRUTH = {"and": "&", "or": "|", "xor": "^", "eq": "==", "ne": "!="}
UFUNCS = {
    "abs": "abs", "acos": "arccos", "acosh": "arccosh", "asin": "arcsin", "asinh": "arcsinh", "atan": "arctan",
    "atan2": "arctan2", "atanh": "arctanh", "cbrt": "cbrt", "ceil": "ceil", "cos": "cos", "cosh": "cosh", "exp": "exp",
    "exp2": "exp2", "expm1": "expm1", "floor": "floor", "log": "log", "log1p": "log1p", "max": "maximum", "min": "minimum",
    "pow": "power", "rem": "fmod", "round_even": "rint", "sign": "sign", "sin": "sin", "sinh": "sinh", "sqrt": "sqrt",
    "tan": "tan", "tanh": "tanh", "is_finite": "isfinite",
}  # fmt: skip
BY_MATH = {"erf": "erf", "erfc": "erfc", "lgamma": "lgamma"}  # of the standard library, rounded to the precision


class NumPy(AbstractLanguage):
    """Numbers are numpy.float32 or numpy.float64 scalars."""

    def __init__(self):
        self.constants: dict[str, str] = {}  # literal -> its name: made once, at import

    def number(self, value: Any) -> str:
        text = str(value) if value.dtype.kind == "b" or np.isfinite(value) else repr(str(value))
        made = f"np.{'bool_' if value.dtype.kind == 'b' else value.dtype.name}({text})"
        return self.constants.setdefault(made, f"c{len(self.constants)}")

    def pattern(self, line: Assign) -> tuple[str, bool]:
        op, given = line.op, line.given
        if op == "select":
            return "{2} if {0} else {1}", True
        if op == "convert":
            return self._convert(line), False
        if given.kind == "b" and op != "is_finite":
            return ("~{0}", True) if op == "not" else (f"{{0}} {TRUTH[op]} {{1}}", True)
        if op in INFIX:
            return f"{{0}} {INFIX[op]} {{1}}", True
        if op == "neg":
            return "-{0}", True
        if op == "round_away":
            return "np.copysign(np.floor(abs({0}) + type({0})(0.5)), {0})", False
        if op in BY_MATH:
            return f"np.{given.name}(math.{BY_MATH[op]}({{0}}))", False
        return f"np.{UFUNCS[op]}({', '.join(f'{{{i}}}' for i in range(len(line.operands)))})", False

    @staticmethod
    def _convert(line: Assign) -> str:
        to = line.dtype
        if to.kind in "iu" and line.given.kind == "f":
            return f"whole({{0}}, np.{to.name})"
        return f"np.{'bool_' if to.kind == 'b' else to.name}({{0}})"

    def define(self, name: str, dtype: np.dtype, text: str) -> str:
        return f"{name} = {text}"

    def loop(
        self, loop: Loop, names: Sequence[str], starts: Sequence[str], body: Sequence[str], aheads: Sequence[str]
    ) -> list[str]:
        text = [f"{name} = {start}" for name, start in zip(names, starts, strict=True)]
        text += [f"for _ in range({loop.length}):", *(self.tab + line for line in body)]
        return [*text, f"{self.tab}{', '.join(names)} = {', '.join(aheads)}"]
