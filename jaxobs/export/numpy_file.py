"""An observer as a Python file that needs NumPy alone, and the same function at once."""

import textwrap
from typing import Any

import numpy as np

from jaxobs._version import __version__
from jaxobs.export.c_file import cells, sizes
from jaxobs.export.numpy_language import NumPy
from jaxobs.export.straight import Function, Straight, straight
from jaxobs.export.tick import Tick
from jaxobs.export.writing import Text
from jaxobs.observers import AbstractStepObserver

WHOLE = '''

def whole(x, kind):
    """Towards zero; NaN is 0, what does not fit is the nearest that does."""
    limits = np.iinfo(kind)
    return kind(0 if x != x else min(max(float(x), limits.min), limits.max))
'''


class NumpyStep:
    """state = start(xhat0); state, xhat = step(k, state, u, y): `Tick` in NumPy scalars, without JAX.

    state: a tuple of NumPy scalars. u (m,) and y (p,), NaN where lost. `source`: the file that the functions are from.
    """

    def __init__(self, code: Straight, source: str):
        self.source, self.dtypes, self.real = source, code.dtypes, code.real.type
        made: dict[str, Any] = {}
        exec(compile(source, "<jaxobs.export.numpy_step>", "exec"), made)
        self._start, self._step = made["start"], made["step"]

    def start(self, xhat0: Any) -> tuple[Any, ...]:
        return self._start(np.asarray(xhat0, self.real))

    def __call__(self, k: Any, state: tuple[Any, ...], u: Any, y: Any) -> tuple[tuple[Any, ...], np.ndarray]:
        return self._step(k, state, u, y)


def numpy_step(observer: AbstractStepObserver, hold_innovation: bool = False) -> NumpyStep:
    """One sample of a step observer in NumPy. Unsupported, a ValueError, names an operation that cannot be written so."""
    code = straight(Tick(observer, hold_innovation))
    return NumpyStep(code, numpy_file(code, "observer"))


def numpy_file(code: Straight, name: str, about: str = "No certificate came with it.") -> str:
    """The text of the Python file. about: what is said of certificate and theorem at its head."""
    real = f"np.{code.real.name}"
    tables = [f"{key} = ({', '.join(f'{real}({x!s})' for x in value.reshape(-1))},)" for key, value in code.tables.items()]
    language = NumPy()
    start = _function(language, code.start, {"xhat0": cells("xhat0", code.n)})
    places = {"z": cells("z", len(code.dtypes)), "u": cells("u", code.m), "y": cells("y", code.p), "k": ["k"]}
    places |= {key: cells(key, value.size) for key, value in code.tables.items()}
    step = _function(language, code.step, places)
    ends, count = step[1], len(code.dtypes)
    constants = [f"{key} = {made}" for made, key in language.constants.items()]
    body = "\n".join(f"        {line}" for line in step[0])
    first = "\n".join(f"        {line}" for line in start[0])
    said = "\n".join(textwrap.wrap(about, 116, replace_whitespace=False)).replace("\\", "\\\\").replace('"', "'")
    used = body + "".join(ends) + first + "".join(start[1])
    return f'''"""{name}: a state observer of {sizes(code)}. Written by jaxobs {__version__}.

{said}
"""

import math

import numpy as np

{chr(10).join([*tables, *constants])}
{WHOLE if "whole(" in used else ""}

def start(xhat0):
    """The state z, a tuple of {count} numbers, for the first guess xhat0 ({code.n},)."""
    with np.errstate(all="ignore"):
{first}
        return ({_tuple(start[1])})


def step(k, z, u, y):
    """(z, xhat) of sample k = 0, 1, ...: u ({code.m},) and y ({code.p},) are {real}, NaN in y where it was lost."""
    with np.errstate(all="ignore"):
        k = np.int32(k)
{body}
        return ({_tuple(ends[:count])}), np.array([{", ".join(ends[count:])}], {real})
'''.replace("\n\n        return", "\n        return").replace("import math\n\n", "import math\n\n" if "math." in used else "")


def _function(language: NumPy, function: Function, places: dict[str, list[str]]) -> tuple[list[str], list[str]]:
    text = Text(language, function.lines, function.results, places)
    return text.body, [text.operand(one) for one in function.results]


def _tuple(parts: list[str]) -> str:
    return "".join(f"{part}, " for part in parts).rstrip(" ")
