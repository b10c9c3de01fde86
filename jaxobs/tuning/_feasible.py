"""Starts from which the rate is proved: as given, or moved until it is."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs.designs import Infeasible
from jaxobs.tuning.certifiers.base import AbstractCertifier
from jaxobs.tuning.descent import Search, backtracking_lbfgs

BLOCK, BLOCKS = 20, 5  # steps of the search for a feasible start, for each weight of the barrier
ROOM = 1e-4  # by which a start proves more than the rate, relative; less than what `Case` leaves it
CENTRING = (1e-1, 1e-2, 1e-3)  # weights of the barrier against the missing rate
INSIDE = 0.5  # where a round starts, above the last s, in its units: at the edge itself nothing moves
DOUBLINGS = 60  # of the rate that is given up until something is proved


class Candidate(NamedTuple):
    """A start: its number, theta, the rate it shall prove, the certifier's constants and witnesses, what its loss is mixed of,
    whether theta was moved."""

    start: int
    theta: Any
    rate: float
    fixed: Any = ()
    free: Any = ()
    mix: tuple[float, ...] = (1.0,)
    repaired: bool = False


class PhaseOne:
    """min s such that the rate - s is proved (the factor + s), over the witnesses, and if that is not enough over theta too.

    Source: Boyd and Vandenberghe, Convex Optimization, section 11.4.1.
    """

    def __init__(self, make: Callable[[Any], Any], certify: AbstractCertifier):
        self.make, self.certify = make, certify
        self.sign = -1.0 if certify.unit == "a step" else 1.0
        self.barrier = jax.jit(lambda theta, fixed, free, rate: certify.barrier(make(theta), fixed, free, rate))
        self.searches = {moving: Search(self._loss(moving), backtracking_lbfgs()) for moving in (False, True)}

    def ready(self, given: Sequence[Candidate]) -> tuple[list[Candidate], list[tuple[int, float]]]:
        """(the candidates that prove their rates, those that do not with the rate they came to). Infeasible if none does."""
        ready, dropped = [], []
        for one in given:
            found = self.certify.start(self.make(one.theta), one.rate)
            candidate, reached = self._moved(one._replace(fixed=found.fixed, free=found.free), found.rate)
            if candidate is None:
                dropped.append((one.start, reached))
            else:
                ready.append(candidate)
        if not ready:
            unit, rate = self.certify.unit, given[0].rate
            best = (min if unit == "a step" else max)(reached for _, reached in dropped)
            change = f"The nearest that was reached is {best:.6g} {unit}: ask for that, or narrow the bounds."
            reason = f"no start proves the rate {rate:.6g} {unit}, and none could be moved until it does"
            raise Infeasible(reason, -abs(best - rate), change, best=best, tried=(f"{len(given)} starts",))
        return ready, dropped

    def _loss(self, moving: bool) -> Callable[[Any, Any, Any], Any]:
        def loss(variables: Any, arg: Any, centring: Any) -> tuple[Any, Any]:
            (theta, free, s), (own, fixed, rate, unit) = variables, arg
            depth = self.barrier(theta if moving else own, fixed, free, rate - self.sign * s * unit)
            return s + centring * depth, ()

        return loss

    def _proves(self, one: Candidate, missing: float) -> bool:
        rate = jnp.asarray(one.rate - self.sign * missing)
        return bool(np.isfinite(self.barrier(one.theta, one.fixed, one.free, rate)))

    def _moved(self, one: Candidate, known: float) -> tuple[Candidate | None, float]:
        """(the candidate that proves its rate or None, the rate reached); known: what is proved of it so far."""
        missing = self.sign * (one.rate - known) if np.isfinite(known) else 0.0
        room = ROOM * max(abs(one.rate), abs(missing), 1e-9)
        if self._proves(one, -room):
            return one, one.rate
        unit = max(missing, room)
        for _ in range(DOUBLINGS):
            if self._proves(one, unit):
                break
            unit *= 2
        else:
            return None, -self.sign * np.inf
        best = unit = 2 * unit
        for moving in (True,) if np.isfinite(known) else (False, True):  # a known rate is the best over the witnesses
            for centring in CENTRING:
                one = recentred(self.certify, one)
                state = self.searches[moving].begin(_first_axis((one.theta, one.free, best / unit + INSIDE)))
                args, now, s = _first_axis((one.theta, one.fixed, one.rate, unit)), one, best / unit
                for _ in range(BLOCKS):
                    state, _ = self.searches[moving].run(state, args, BLOCK, jnp.asarray(centring))
                    theta, free, s = jax.tree.map(lambda a: a[0], state.best)
                    now = one._replace(theta=theta if moving else one.theta, free=free, repaired=moving)
                    if self._proves(now, -room):
                        return now, now.rate
                if np.isfinite(state.value[0]):
                    one, best = now, min(best, float(s) * unit)
        return None, one.rate - self.sign * best


def recentred(certify: AbstractCertifier, one: Candidate) -> Candidate:
    fixed, free = certify.recentred(one.fixed, one.free)
    return one._replace(fixed=fixed, free=free)


def _first_axis(tree: Any) -> Any:
    return jax.tree.map(lambda a: jnp.asarray(a)[None], tree)
