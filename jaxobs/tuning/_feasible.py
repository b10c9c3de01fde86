"""Starts from which the rate is proved: as given, or moved until it is."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs.designs import Infeasible
from jaxobs.tuning.certifiers.base import AbstractCertifier
from jaxobs.tuning.descent import Search, backtracking_lbfgs

BLOCK, BLOCKS = 20, 5  # steps of the search for a feasible start, for each weight of the barrier
ROOM = 1e-4  # by which a start proves more than the rate, relative: less than a case stays below its largest rate
CENTRING = (1e-1, 1e-2, 1e-3)  # weights of the barrier against the missing rate
DOUBLINGS = 60  # of the rate that is given up until something is proved


class Candidate(NamedTuple):
    """A start: its number, theta, the certifier's constants and witnesses, whether theta was moved."""

    start: int
    theta: Any
    fixed: Any
    free: Any
    repaired: bool


def first_candidates(
    make: Callable[[Any], Any], thetas: list[Any], certify: AbstractCertifier, rate: float
) -> tuple[list[Candidate], list[tuple[int, float]]]:
    """(the starts that prove the rate, those that do not with the rate they came to). Infeasible if there are none."""
    ready, dropped = [], []
    for i, theta in enumerate(thetas):
        found = certify.start(make(theta), rate)
        candidate, reached = _moved(make, certify, rate, Candidate(i, theta, found.fixed, found.free, False), found.rate)
        if candidate is None:
            dropped.append((i, reached))
        else:
            ready.append(candidate)
    if not ready:
        best = (min if certify.unit == "a step" else max)(reached for _, reached in dropped)
        change = f"The nearest that was reached is {best:.6g} {certify.unit}: ask for that, or narrow the bounds."
        reason = f"no start proves the rate {rate:.6g} {certify.unit}, and none could be moved until it does"
        raise Infeasible(reason, -abs(best - rate), change, best=best, tried=(f"{len(thetas)} starts",))
    return ready, dropped


def _moved(
    make: Any, certify: AbstractCertifier, rate: float, start: Candidate, known: float
) -> tuple[Candidate | None, float]:
    """Phase one: min s such that the rate - s is proved (the factor + s), over the witnesses, and if that is not enough over
    theta as well. Source: Boyd and Vandenberghe, Convex Optimization, section 11.4.1.
    """
    sign = -1.0 if certify.unit == "a step" else 1.0

    @jax.jit
    def barrier(theta: Any, free: Any, missing: Any) -> Any:
        return certify.barrier(make(theta), start.fixed, free, jnp.asarray(rate - sign * missing))

    def proves(theta: Any, free: Any, missing: float) -> bool:
        return bool(np.isfinite(barrier(theta, free, missing)))

    room = ROOM * max(abs(rate), abs(known) if np.isfinite(known) else 0.0, 1e-9)
    theta, free = start.theta, start.free
    if proves(theta, free, -room):
        return start, rate
    unit = sign * (rate - known) if np.isfinite(known) and sign * (rate - known) > 0 else room
    for _ in range(DOUBLINGS):
        if proves(theta, free, 2 * unit):
            break
        unit *= 2
    else:
        return None, -sign * np.inf
    unit = best = 2 * unit
    for over_theta in (False, True) if jax.tree.leaves(free) else (True,):

        def loss(variables: Any, own: Any, centring: Any, over_theta: bool = over_theta) -> tuple[Any, Any]:
            theta, free, s = variables
            return s + centring * barrier(theta if over_theta else own, free, s * unit), ()

        search = Search(loss, backtracking_lbfgs())
        for centring in CENTRING:
            state = search.begin(_first_axis((theta, free, best / unit)))
            for _ in range(BLOCKS):
                state, _ = search.run(state, _first_axis(theta), BLOCK, jnp.asarray(centring))
                moved, found, s = jax.tree.map(lambda a: a[0], state.best)
                at = moved if over_theta else theta
                if proves(at, found, -room):
                    return start._replace(theta=at, free=found, repaired=over_theta), rate
            if np.isfinite(state.value[0]):
                theta, free, best = at, found, min(best, float(s) * unit)
    return None, rate - sign * best


def _first_axis(tree: Any) -> Any:
    return jax.tree.map(lambda a: jnp.asarray(a)[None], tree)
