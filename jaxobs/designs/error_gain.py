"""The gain with which an observer's innovation enters its error, as designs and certificates write it."""

import functools
from typing import Any

from jaxtyping import Array, Float

from jaxobs._module import refuse
from jaxobs.observers import (
    HighGain,
    InnerInjection,
    IntegralHighGain,
    Luenberger,
    OutputInjection,
    StepIntegral,
    StepLuenberger,
)


@functools.singledispatch
def error_gain(observer: Any) -> Float[Array, "N p"]:
    """L of e' = (a + sum_k rho_k b_k c_k' - L output) e. Others may register theirs: error_gain.register(MyObserver, f)."""
    fix = "Register it: jaxobs.tuning.error_gain.register(MyObserver, lambda observer: L)."
    raise refuse("error_gain", "observer", type(observer).__name__, "an observer whose gain is known here", fix)


@error_gain.register(HighGain)
@error_gain.register(IntegralHighGain)
def _(observer: Any) -> Array:
    return observer.gain()[:, None]


@error_gain.register(Luenberger)
@error_gain.register(StepLuenberger)
@error_gain.register(InnerInjection)
@error_gain.register(OutputInjection)
def _(observer: Any) -> Array:
    return observer.gain


@error_gain.register(StepIntegral)
def _(observer: Any) -> Array:
    return observer.gain[:, None]
