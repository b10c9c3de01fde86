"""Derivatives that somebody declared: what JAX then differentiates is not the function."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.extend import source_info_util

from jaxobs._module import refuse

# JAX's logaddexp, sinc and others declare theirs, and so do the polynomials of this package.
OWN = tuple(str(one) + os.sep for one in (Path(jax.__file__).parent, Path(__file__).parents[1]))
BY_PARTS = "custom_derivatives.py"  # where the rule seems to be from if it was declared by defjvps
PARTS = ("relu", "relu6", "logit")
SHIFTED = ("logsumexp", "log_softmax", "_softmax", "_softmax_deprecated")  # by a largest entry, on which they do not depend


def require_derivatives(owner: str, f: Callable[..., Any], *sizes: int, name: str = "f") -> None:
    """ValueError if f, of vectors of these sizes, has declared derivatives: custom_jvp, custom_vjp or stop_gradient, at any
    depth, other than those in functions of JAX and of this package, which are true. name: what f is called in it.

    Bounds on slopes would be about what is declared, and a proof that rests on them be none.
    """
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        closed = jax.make_jaxpr(f)(*(jax.ShapeDtypeStruct((size,), np.float64) for size in sizes))
    for rule, place in declared(closed.jaxpr):
        fix = "Write the function out, so that its derivative is that of its formulas."
        raise refuse(owner, name, f"a function with {rule} ({place})", "one without declared derivatives", fix)


def declared(jaxpr: Any) -> Iterator[tuple[str, str]]:
    """The declared derivatives that are not known to be true, at any depth: what they are, and where."""
    for equation in jaxpr.eqns:
        name, bodies = equation.primitive.name, _bodies(equation)
        custom = name.startswith(("custom_jvp", "custom_vjp"))
        if custom and not _is_own(equation, bodies):
            yield name, _place(equation, bodies)
        elif name == "stop_gradient" and not _is_shift(equation):
            yield name, Path(source_info_util.summarize(equation.source_info)).name
        for body in bodies:
            yield from declared(body)


def _bodies(equation: Any) -> list[Any]:
    """The jaxprs that an equation carries."""
    parts = [one for value in equation.params.values() for one in (value if isinstance(value, list | tuple) else [value])]
    return [body for one in parts if hasattr(body := getattr(one, "jaxpr", one), "eqns")]


def _is_own(equation: Any, bodies: list[Any]) -> bool:
    """Whether function and rule are both from JAX or from here. A root is not: who calls for it gives its derivative."""
    rule = getattr(equation.params.get("jvp_jaxpr_fun"), "debug_info", None)
    if rule is None or len(bodies) != 1 or not all(_file(one).startswith(OWN) for one in (rule, bodies[0].debug_info)):
        return False
    name = str(bodies[0].debug_info.func_name)
    if _file(rule).endswith(BY_PARTS):  # whose parts they are is not seen: those of JAX call no other such function
        return name in PARTS and not any(one.primitive.name.startswith("custom") for one in _all(bodies[0]))
    return name != "_custom_root"


def _place(equation: Any, bodies: list[Any]) -> str:
    """The file of the function, or of its rule if that is whose."""
    infos = [getattr(equation.params.get("jvp_jaxpr_fun"), "debug_info", None), *(body.debug_info for body in bodies)]
    files = [_file(one) for one in infos if one is not None]
    return Path(next((one for one in files if not one.startswith(OWN)), files[-1] if files else "?")).name


def _all(jaxpr: Any) -> Iterator[Any]:
    for equation in jaxpr.eqns:
        yield equation
        for body in _bodies(equation):
            yield from _all(body)


def _is_shift(equation: Any) -> bool:
    """Whether stop_gradient was called by a function of JAX in which it changes no derivative."""
    traceback = equation.source_info.traceback
    frames = [(one.file_name, one.function_name) for one in traceback.frames] if traceback is not None else []
    called = next((k for k, (file, name) in enumerate(frames) if name == "stop_gradient" and file.startswith(OWN)), None)
    if called is None or called + 1 == len(frames):
        return False
    file, name = frames[called + 1]
    return name in SHIFTED and file.startswith(OWN)


def _file(info: Any) -> str:
    return str(info.func_filename)
