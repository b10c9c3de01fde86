"""A flow observer over samples that come when they come."""

import math
from os import PathLike
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._loop import as_state
from jaxobs._module import dtype_of, refuse, require_instance
from jaxobs.integrators import RK4, AbstractIntegrator, Field
from jaxobs.observers import AbstractFlowObserver
from jaxobs.streaming import saved
from jaxobs.streaming.given import driven, measured, period, require_observer, seconds

COUNTS = ("taken", "lost", "rejected")


class IrregularRunner:
    """Between samples at t_{k-1} and t_k, whatever the time between them, the observer's flow with the innovation held,

        z' = flow(t, z, u_{k-1}, y_{k-1} + predict(t, z) - predict(t_{k-1}, z_{k-1})),    xhat_k = estimate(t_k, z, u_k, y_k).

    It is what designs.sampled_data proves for intervals up to delta, regular or not. A lost component has the innovation zero:
    the model alone moves it on. A sample that is not later than the one before is ignored and counted as rejected.

    observer: a flow observer. integrator: RK4() if not given, in equal steps of at most longest_step [s]; none that needs an
    even grid. longest_gap [s]: a longer time between two samples is refused. xhat0 (n,). Time counts from the first sample.
    ValueError names the argument that does not fit.
    """

    def __init__(
        self,
        observer: AbstractFlowObserver,
        *,
        xhat0: Any,
        longest_step: float,
        integrator: AbstractIntegrator | None = None,
        longest_gap: float = 10.0,
    ):
        require_observer("IrregularRunner", observer)
        fix = "A step observer is made for one period: take Runner."
        require_instance("IrregularRunner", "observer", observer, AbstractFlowObserver, fix)
        self.observer, self.integrator = observer, RK4() if integrator is None else integrator
        require_instance("IrregularRunner", "integrator", self.integrator, AbstractIntegrator, "Build it first, e.g. RK4().")
        if self.integrator.needs_uniform_grid:
            given = type(self.integrator).__name__
            raise refuse(
                "IrregularRunner", "integrator", given, "one that takes steps of any length", "Take RK4() or Adaptive()."
            )
        self.longest_step = period("IrregularRunner", "longest_step", longest_step)
        self.longest_gap = period("IrregularRunner", "longest_gap", longest_gap)
        self._dtype = np.dtype(dtype_of(observer))
        self._step = jax.jit(self._moved)
        self.restart(xhat0)

    def restart(self, xhat0: Any) -> None:
        """Forgets all samples: the next one is at time 0 of the model."""
        self.xhat = np.array(as_state("IrregularRunner", "xhat0", xhat0, self.observer.n, self._dtype))
        self.t0 = self.t = float("nan")
        zero = jnp.zeros(self.observer.m, self._dtype), jnp.zeros(self.observer.p, self._dtype)
        self._state = (self.observer.init(jnp.array(self.xhat)), *zero)
        self.counts = dict.fromkeys(COUNTS, 0)

    def update(self, t: Any, y: Any = None, u: Any = None) -> np.ndarray:
        """xhat (n,) with this sample: its time t [s], y (p,) or None, u (m,) from now on."""
        time, observer = seconds("IrregularRunner", "t", t), self.observer
        y = measured("IrregularRunner", y, observer.p, self._dtype)
        u = driven("IrregularRunner", u, observer.m, self._dtype)
        first = math.isnan(self.t)
        if not first and time <= self.t:
            self.counts["rejected"] += 1
            return self.xhat
        length = 0.0 if first else time - self.t
        if length > self.longest_gap:
            fix = "Call restart(xhat0): too much was missed to go on from."
            raise refuse("IrregularRunner", "t", f"{time}, {length:.6g} s after the last", f"at most {self.longest_gap} s", fix)
        self.t0 = time if first else self.t0
        count = np.int32(max(1, math.ceil(length / self.longest_step)))
        real = self._dtype.type
        self._state, xhat = self._step(self._state, real(time - self.t0 - length), real(length), count, u, y)
        self.t, self.xhat = time, np.asarray(xhat)
        self.counts["lost" if np.isnan(y).any() else "taken"] += 1
        return self.xhat

    def _moved(self, state: Any, t: Any, length: Any, count: Any, u: Any, y: Any) -> tuple[Any, Any]:
        observer = self.observer
        z, held_u, innovation = state
        h = length / count.astype(length.dtype)

        def flow(time: Any, x: Any) -> Any:
            return observer.flow(time, x, held_u, innovation + observer.predict(time, x, held_u))

        field = Field(flow)
        cache = self.integrator.prepare(field, h, z)
        z = jax.lax.fori_loop(0, count, lambda i, x: self.integrator.step(field, cache, t + i.astype(h.dtype) * h, h, x), z)
        now = t + length
        expected = observer.predict(now, z, u)
        valid = jnp.isfinite(y)
        seen = jnp.where(valid, y, expected)
        return (z, u, seen - expected), observer.estimate(now, z, u, seen)

    def save(self, path: str | PathLike[str]) -> None:
        """The whole state as a small JSON file, every number exact."""
        now = {"t": self.t.hex(), "t0": self.t0.hex(), "counts": self.counts, "arrays": saved.arrays((self._state, self.xhat))}
        settings = {"longest_step": self.longest_step, "longest_gap": self.longest_gap}
        saved.write(path, "IrregularRunner", (self.observer, self.integrator), settings, now)

    @classmethod
    def restore(
        cls, observer: AbstractFlowObserver, path: str | PathLike[str], integrator: AbstractIntegrator | None = None
    ) -> "IrregularRunner":
        """The runner that was saved. ValueError as for Runner.restore."""
        require_observer("IrregularRunner", observer)
        found = saved.read(path, "IrregularRunner")
        made = cls(observer, xhat0=np.zeros(observer.n), integrator=integrator, **found["settings"])
        saved.require_same(path, (made.observer, made.integrator), found["observer"])
        now = found["state"]
        made._state, made.xhat = saved.tree(path, (made._state, made.xhat), now["arrays"])
        made.t, made.t0, made.counts = float.fromhex(now["t"]), float.fromhex(now["t0"]), dict(now["counts"])
        return made
