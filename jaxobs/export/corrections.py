"""By what each observer corrects itself, and where its gain stands in a certificate about it."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs.observers import (
    CurrentLuenberger,
    DiscreteTracker,
    HighGain,
    InnerInjection,
    IntegralHighGain,
    Luenberger,
    StepIntegral,
    StepLuenberger,
)


@functools.singledispatch
def corrects(observer: Any, certificate: Any) -> np.ndarray | None:
    """`output` (p, n) of e' = (a + ... - gain output) e, or e+; None for an observer whose error is not known here.

    Others may register theirs: corrects.register(MyObserver, f).
    """
    return None


@corrects.register(HighGain)
@corrects.register(Luenberger)
@corrects.register(StepLuenberger)
@corrects.register(InnerInjection)
def _(observer: Any, certificate: Any) -> np.ndarray:
    return _sees(observer)


@corrects.register(IntegralHighGain)
@corrects.register(StepIntegral)
def _(observer: Any, certificate: Any) -> np.ndarray:
    """eps_1, which is the innovation without integrators; where that is held between samples, what the integrators take."""
    size = observer.n + observer.q
    place = observer.q if hasattr(certificate, "delta") else 0
    return np.eye(size)[place : place + 1]


@corrects.register(CurrentLuenberger)
def _(observer: Any, certificate: Any) -> np.ndarray:
    """C a: the prediction is corrected, with C b = 0 (see `designs.current_form`)."""
    c, b = _sees(observer), np.asarray(certificate.b, float)
    return c @ np.asarray(certificate.a, float) if not np.any(c @ b) else np.full_like(c, np.nan)


@corrects.register(DiscreteTracker)
def _(observer: Any, certificate: Any) -> np.ndarray:
    return np.asarray(certificate.a, float)[:1]


def _sees(observer: Any) -> np.ndarray:
    """C of y = C x, that of the model."""
    model = observer.model
    x, u = jnp.zeros(model.n), jnp.zeros(model.m)
    return np.asarray(jax.jacfwd(lambda x: model.h(x, u))(x), float)


def is_behind(certificate: Any) -> bool:
    """Whether it is about a held innovation behind integrators: the gain is in `a` then, see `designs.held_behind`."""
    if not hasattr(certificate, "delta"):
        return False
    held, seen = np.asarray(certificate.gain, float), np.asarray(certificate.output, float)
    q = int(np.argmax(seen[0])) if seen.shape[0] == 1 else 0
    size = len(held)
    return q > 0 and np.array_equal(seen, np.eye(size)[q : q + 1]) and np.array_equal(held, -np.eye(size)[:, q - 1 : q])


def places(certificate: Any) -> tuple[str, ...]:
    """The tables of the code that a certificate is about."""
    return tuple(name for name in ("gain", "inner") if hasattr(certificate, name))


def stored_table(certificate: Any, name: str) -> np.ndarray:
    """The numbers of that table in a certificate."""
    if name == "gain" and is_behind(certificate):
        return -np.asarray(certificate.a, float)[:, 0]
    return np.asarray(getattr(certificate, name), float)
