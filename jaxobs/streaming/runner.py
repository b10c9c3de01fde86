"""An observer one sample at a time, on an even grid that follows the sampling clock."""

from collections import deque
from os import PathLike
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._loop import as_state, check_period
from jaxobs._module import dtype_of, refuse, require_instance, require_integer
from jaxobs.export import Tick, numpy_step
from jaxobs.integrators import RK4, AbstractIntegrator
from jaxobs.observers import AbstractFlowObserver, Observer, Sampled
from jaxobs.streaming import saved
from jaxobs.streaming.given import driven, measured, period, require_observer, seconds

COUNTS = ("taken", "lost", "bridged", "late", "repeated", "rejected")
LAST = 2**31 - 1  # the greatest k that a step is given, 24 days at 1 kHz; it stays there, as in exported C
FOLLOW = 1 / 16  # of a sample's distance to the grid: as far as the grid moves towards it; the first ones count more


class Passed(NamedTuple):
    """A sample that was taken, or bridged, with the state before it: a late one may still change it."""

    k: int
    state: Any
    u: np.ndarray
    y: np.ndarray
    bridged: bool


class Runner:
    """xhat_k = estimate(k, z_k, u_k, y_k), then z_{k+1} = step(k, z_k, u_k, y_k): one sample for each call of `update`.

    A sample belongs to the nearest point of a grid of period dt [s], which starts at the first sample and moves towards every
    further one by a sixteenth of its distance: jitter up to a fifth of a period and a clock that drifts do no harm.

        lost          y is None, or NaN or infinite in a component: its innovation is zero, or with hold_innovation that of the
                      last sample that came
        a gap         the points without a sample are bridged as lost ones, with the last u; more than longest_gap are refused
        late          a sample for a point that was passed without it takes its place, and the run is repeated from there, if it
                      is among the last `rewind` points (the last one always is); the state is then as if it had come in time
        repeated      a sample for a point that has one is ignored, as is a late one that is too old

    `counts` says how often each was: taken and lost by update; bridged; late; repeated (the last point again), rejected.

    observer: a step observer, or a flow observer, which becomes Sampled(observer, integrator, dt), integrator RK4() if not
    given. dt has to be that of a step observer that has one. xhat0 (n,). backend: "jax", jitted, or "numpy", without JAX while
    it runs; the two agree to rounding. Memory does not grow. Not for several threads at once. ValueError names the argument
    that does not fit.
    """

    def __init__(
        self,
        observer: Observer,
        dt: float,
        *,
        xhat0: Any,
        integrator: AbstractIntegrator | None = None,
        backend: str = "jax",
        hold_innovation: bool = False,
        rewind: int = 0,
        longest_gap: int = 10_000,
    ):
        require_observer("Runner", observer)
        self.dt = period("Runner", "dt", dt)
        require_instance("Runner", "integrator", integrator, AbstractIntegrator | None, "Build it first, e.g. RK4().")
        require_integer("Runner", "rewind", rewind, 0, "How many of the last points a late sample may be among.")
        require_integer("Runner", "longest_gap", longest_gap, 0, "How many missed samples are bridged.")
        if backend not in ("jax", "numpy"):
            raise refuse("Runner", "backend", repr(backend), "'jax' or 'numpy'", "'numpy' steps without JAX.")
        self._dtype = np.dtype(dtype_of(observer))
        if isinstance(observer, AbstractFlowObserver):
            observer = Sampled(observer, integrator or RK4(), jnp.asarray(dt, self._dtype))
        elif integrator is not None:
            raise refuse("Runner", "integrator", type(integrator).__name__, "none for a step observer", "Leave it out.")
        check_period("Runner", observer, jnp.asarray(dt, self._dtype))
        self.observer, self.backend, self.rewind, self.longest_gap = observer, backend, rewind, longest_gap
        self.hold_innovation, self._m, self._p = hold_innovation, observer.m, observer.p
        if backend == "numpy":
            self._step = numpy_step(observer, hold_innovation)
            self._start = self._step.start
        else:
            tick = Tick(observer, hold_innovation)
            self._step = jax.jit(lambda k, state, u, y: tick(k, state, u, y))
            self._start = lambda xhat: tick.start(jnp.array(xhat))
        self.restart(xhat0)

    def restart(self, xhat0: Any) -> None:
        """Forgets all samples: the next one starts the grid anew, and the counts."""
        self.xhat = np.array(as_state("Runner", "xhat0", xhat0, self.observer.n, self._dtype))
        self.k, self.t = -1, float("nan")
        self._state, self._u = self._start(self.xhat), np.zeros(self.observer.m, self._dtype)
        self.counts = dict.fromkeys(COUNTS, 0)
        self._past: deque[Passed] = deque(maxlen=max(self.rewind, 1))

    def update(self, t: Any, y: Any = None, u: Any = None) -> np.ndarray:
        """xhat (n,), read-only, with this sample: its time t [s], y (p,) or None, u (m,) from now on.

        `t` and `k` are then the time and number of the grid's last point, `xhat` the estimate there.
        """
        time = seconds("Runner", "t", t)
        y, u = measured("Runner", y, self._p, self._dtype), driven("Runner", u, self._m, self._dtype)
        ahead = 1 if self.k < 0 else round(min(max((time - self.t) / self.dt, -LAST), LAST))
        if ahead <= 0:
            return self._behind(self.k + ahead, u, y)
        if ahead - 1 > self.longest_gap:
            fix = "Call restart(xhat0): too much was missed to go on from."
            raise refuse("Runner", "t", f"{time} after a gap of {ahead - 1} samples", f"at most {self.longest_gap}", fix)
        for k in range(self.k + 1, self.k + ahead):
            self._advance(k, self._u, np.full(self._p, np.nan, self._dtype), bridged=True)
        self._advance(self.k + ahead, u, y, bridged=False)
        grid = time if self.k < 0 else self.t + ahead * self.dt
        self.k, self._u = self.k + ahead, u
        self.t = grid + max(FOLLOW, 1 / (self.k + 1)) * (time - grid)
        self.counts["bridged"] += ahead - 1
        self.counts["lost" if np.isnan(y).any() else "taken"] += 1
        return self.xhat

    def _advance(self, k: int, u: np.ndarray, y: np.ndarray, *, bridged: bool) -> None:
        self._past.append(Passed(k, self._state, u, y, bridged))
        self._state, xhat = self._step(np.int32(min(k, LAST)), self._state, u, y)
        self.xhat = np.asarray(xhat)
        self.xhat.flags.writeable = False  # the caller holds it too

    def _behind(self, k: int, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """A sample for a point that was passed: into its place if that is empty, and all after it once more."""
        known = k == self.k or self.rewind > 0
        past = list(self._past)
        place = next((i for i, one in enumerate(past) if known and one.k == k), None)
        if place is None or not np.any(np.isnan(past[place].y) & ~np.isnan(y)):
            self.counts["repeated" if k == self.k else "rejected"] += 1
            return self.xhat
        old, after = past[place], past[place + 1 :]
        self._past = deque(past[:place], maxlen=self._past.maxlen)
        self._state = old.state
        u = u if old.bridged else old.u
        self._advance(k, u, np.where(np.isnan(old.y), y, old.y), bridged=False)
        bridged = old.bridged
        for one in after:
            bridged = bridged and one.bridged  # the points bridged after it had the u before it
            self._advance(one.k, u if bridged else one.u, one.y, bridged=one.bridged)
        self._u = self._past[-1].u
        self.counts["late"] += 1
        return self.xhat

    def save(self, path: str | PathLike[str]) -> None:
        """The whole state as a small JSON file, every number exact: `restore` goes on as if it had never stopped."""
        past = [{"k": one.k, "bridged": one.bridged, "arrays": saved.arrays((one.state, one.u, one.y))} for one in self._past]
        now = {"k": self.k, "t": self.t.hex(), "counts": self.counts, "arrays": saved.arrays((self._state, self._u, self.xhat))}
        names = ("dt", "backend", "hold_innovation", "rewind", "longest_gap")
        saved.write(path, "Runner", self.observer, {name: getattr(self, name) for name in names}, now | {"past": past})

    @classmethod
    def restore(cls, observer: Observer, path: str | PathLike[str], integrator: AbstractIntegrator | None = None) -> "Runner":
        """The runner that was saved, with its settings. ValueError if the file is damaged or of another format, or if this is
        not the observer that ran: what differs is named."""
        require_observer("Runner", observer)
        found = saved.read(path, "Runner")
        made = cls(observer, xhat0=np.zeros(observer.n), integrator=integrator, **found["settings"])
        saved.require_same(path, made.observer, found["observer"])
        now = found["state"]
        shape = (made._state, made._u, made.xhat)
        made._state, made._u, made.xhat = saved.tree(path, shape, now["arrays"])
        made.k, made.t, made.counts = now["k"], float.fromhex(now["t"]), dict(now["counts"])
        y = np.zeros(observer.p, made._dtype)
        for one in now["past"]:
            state, u, seen = saved.tree(path, (made._state, made._u, y), one["arrays"])
            made._past.append(Passed(one["k"], state, u, seen, one["bridged"]))
        return made
