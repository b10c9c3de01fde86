"""One sample of any step observer as one function: what is exported, and what a Runner repeats."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._loop import Sample, begin, tick
from jaxobs._module import Module, dtype_of, require_instance, static
from jaxobs.observers import AbstractStepObserver


class Tick(Module):
    """xhat_k = estimate(k, z_k, u_k, y_k), then z_{k+1} = step(k, z_k, u_k, y_k), as `observe` does it.

    NaN in y_k marks a lost component: its innovation is zero, or that of the last sample that came with `hold_innovation`.
    observer: any step observer; a flow observer becomes one by `observers.Sampled`.
    """

    observer: AbstractStepObserver
    hold_innovation: bool = static(default=False)

    def __check_init__(self):
        require_instance(
            self, "observer", self.observer, AbstractStepObserver,
            "Wrap a flow observer: jaxobs.observers.Sampled(observer, jaxobs.integrators.RK4(), dt).",
        )  # fmt: skip

    def start(self, xhat0: Float[Array, " n"]) -> Any:
        """What goes from sample to sample: the observer's z, and the innovation if it is held."""
        _, z, held, *_ = begin(self.observer, None, self.observer.init(xhat0), dtype_of(self.observer), None)
        return (z, held) if self.hold_innovation else (z,)

    def __call__(self, k: Any, state: Any, u: Float[Array, " m"], y: Float[Array, " p"]) -> tuple[Any, Float[Array, " n"]]:
        """(the next state, xhat_k)."""
        dtype = dtype_of(self.observer)
        valid = jnp.isfinite(y)
        k = jnp.asarray(k)
        time = k.astype(dtype)
        sample = Sample(k, time, time, u, jnp.where(valid, y, 0), valid)
        z, held = state if self.hold_innovation else (*state, jnp.zeros((self.observer.p,), dtype))

        def advance(x, z, sample, y, held):
            return x, self.observer.step(sample.k, z, sample.u, y)

        carry = (None, z, held, {}, jnp.asarray(jnp.inf, dtype))
        (_, z, held, *_), (_, xhat, *_) = tick(self.observer, carry, sample, lambda x, s: s.y, advance, self.hold_innovation)
        return ((z, held) if self.hold_innovation else (z,)), xhat
