"""Forward mode: the derivatives in a few directions move with each lane, as more entries of the same loop."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxobs.studies import scalars
from jaxobs.studies.sensitive import Sensitive, pick, units
from jaxobs.studies.tile import Lane


class Tangents:
    """A lane with d carry / d p_i beside its carry, i = 1, ..., P: what `run_tile` takes in place of `Traced`.

        dc_i+ = (D_c step) dc_i + (D_f step) df_i

    for the carry c and what is fixed, f; the step is linearised once for all directions. What the parameters do not reach (the
    true plant, the noise, counts) has no tangent. A parameter itself has a unit tangent, whose zeros cost nothing.
    """

    def __init__(self, sensitive: Sensitive, of: Callable[[dict[str, Any]], Any]):
        self.sensitive, self.of, traced = sensitive, of, sensitive.traced
        self.members, self.grid, self.arrays, self.rest = traced.members, traced.grid, traced.arrays, traced.rest
        self.samples, self.block = traced.samples, traced.block
        self.directions = units(sensitive.values(traced.arrays))
        self.derived = [k for k, i in enumerate(sensitive.fixed) if i not in sensitive.direct]
        index = tuple(jnp.zeros((), jnp.int32) for _ in self.members.shape)
        self.setup, self.lane = scalars.trace(self._setup, self.arrays, index)
        ts = jax.ShapeDtypeStruct((self.block,), self.grid.ts.dtype)
        k, t = jax.ShapeDtypeStruct((), jnp.int32), jax.ShapeDtypeStruct((), ts.dtype)
        self.draw, drawn = scalars.trace(self._draw, self.lane.fixed, self.lane.keys, ts, k)
        at = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), drawn)
        self.step, _ = scalars.trace(self._step, self.lane.fixed, self.lane.carry, (k, t, t), at)

    def _setup(self, arrays: Any, index: Any) -> Lane:
        sensitive = self.sensitive
        lane = sensitive.traced._setup(arrays, index)
        _, push = jax.linearize(sensitive.setup(arrays, index), sensitive.values(arrays))
        fixed, carry = [], []
        for direction in self.directions:
            one_fixed, one_carry = push([jnp.asarray(one) for one in direction])
            fixed.append([one_fixed[k] for k in self.derived])
            carry.append(one_carry)
        return Lane((lane.fixed, fixed), lane.keys, (lane.carry, carry))

    def _draw(self, fixed: Any, keys: Any, ts: Any, block: Any) -> Any:
        return self.sensitive.traced._draw(fixed[0], keys, ts, block)

    def _step(self, fixed: Any, carry: Any, time: Any, drawn: Any) -> tuple[Any, Any]:
        (fixed, derived), (carry, moving) = fixed, carry
        sensitive = self.sensitive
        start = pick(fixed, sensitive.fixed), pick(carry, sensitive.carry)
        _, push, (after, out) = jax.linearize(sensitive.step(fixed, carry, time, drawn), *start, has_aux=True)
        pushed = []
        for direction, some, dots in zip(self.directions, derived, moving, strict=True):
            known = dict(zip(self.derived, some, strict=True))
            fixed_dots = [
                known[k] if k in known else jnp.asarray(direction[sensitive.direct[i]])
                for k, i in enumerate(sensitive.fixed)
            ]
            pushed.append(push(fixed_dots, dots))
        return (after, pushed), out

    def results(self, carry: Any) -> dict[str, Any]:
        """value, gradient (P,) and the time of divergence of a lane."""
        carry, moving = carry
        value, push = jax.linearize(self.sensitive.end(carry, self.of), pick(carry, self.sensitive.carry))
        gradient = jnp.stack([push(dots) for dots in moving])
        return {"value": value, "gradient": gradient, "diverged_at": carry[-1]}
