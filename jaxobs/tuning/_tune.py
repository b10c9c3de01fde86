"""Gains by gradient, with a proof at the end: descent inside the set of what is certified."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import optax

from jaxobs._module import check, require_integer
from jaxobs.tuning._checks import require_arguments, require_dependence, require_finite_loss
from jaxobs.tuning._feasible import Candidate, PhaseOne
from jaxobs.tuning._stages import WEIGHTS, End, Progress, Stages, means, proved
from jaxobs.tuning.certifiers.base import AbstractCertifier
from jaxobs.tuning.tuned import Tuned


def tune(
    make: Callable[[Any], Any],
    loss: Callable[[Any, Any], Any],
    theta0: Any,
    *,
    certify: AbstractCertifier | None,
    rate: float | None = None,
    keys: Any = None,
    starts: Sequence[Any] = (),
    optimizer: optax.GradientTransformation | None = None,
    steps: int = 100,
    price: bool = True,
    progress: Callable[[Progress], None] | None = None,
) -> Tuned:
    """min over theta of mean_k loss(make(theta), keys[k]),   such that certify proves `rate` of the observer make(theta).

        tuned = jaxobs.tune(make, loss, theta0, certify=Quadratic(model), rate=0.5)
        tuned.observer, tuned.certificate, tuned.history

    make: theta, a pytree of float64 arrays, to an observer. loss(observer, key) -> a number, key None without `keys`: see
    jaxobs.tuning.objectives. keys: PRNG keys, the same at every step (common random numbers). starts: more thetas to start
    from, side by side; the first should be that of a convex design. rate: the decay rate [1/s] to be proved, >= 0, for step
    observers the factor a step in ]0, 1]; 0 (1) if not given.

    The witnesses of the proof are searched along with theta, under a log-barrier whose weight falls in stages of at most
    `steps` steps (optimizer: of optax, L-BFGS with backtracking if not given). At the end the iterates with the least loss are
    proved in exact arithmetic until one holds: a gain that is not proved is never returned unless certify=None is said. price:
    search once more without the certificate, to say what it costs. A start that does not prove the rate is moved until it does.
    Ctrl-C ends the search once it has begun; the best so far is proved and returned. progress: called after every 20 steps.

    Infeasible where no start could be moved to prove the rate; its `best` is the nearest rate that was. ValueError in float32,
    for a theta without numbers, a loss that is not finite at a start (it names start and key) or does not depend on a part of
    theta. Source: Boyd and Vandenberghe, Convex Optimization, chapter 11 (barrier, phase one).
    """
    thetas, rate = require_arguments(theta0, starts, certify, rate)
    require_integer("tune", "steps", steps, 1, "It counts the steps of a stage.")
    make = eqx.filter_jit(make)
    mean = means(make, [loss], keys)
    for i, theta in enumerate(thetas):
        check(make(theta))
        require_finite_loss(mean, theta, i)
    require_dependence(lambda theta: mean(theta)[0][0], thetas[0])
    run = Stages(mean, make, certify, optimizer, steps, progress)
    given = [Candidate(i, theta, rate) for i, theta in enumerate(thetas)]
    first_loss, lanes = run.loss(given[0]), 1 if keys is None else len(keys)
    certificate, free_loss, ready, dropped, unit = None, None, given, [], "1/s"
    if certify is None:
        best = min(run.descend(given, (0.0,)), key=lambda one: one.loss)
        history = run.history(lanes)
    else:
        ready, dropped = PhaseOne(make, certify).ready(given)
        found = run.descend(ready, WEIGHTS) + [End(run.loss(one), one) for one in ready]
        best, certificate = proved(found, make, certify)
        history, unit = run.history(lanes), certify.unit
        if price and not run.stopped:
            free_loss = min([best.loss, *(end.loss for end in run.descend(ready, (0.0,)))])
    one = best.candidate
    return Tuned(
        observer=make(one.theta), certificate=certificate, history=history, theta=one.theta, loss=best.loss,
        first_loss=first_loss, free_loss=free_loss, rate=rate, unit=unit, start=one.start,
        repaired=tuple(other.start for other in ready if other.repaired), dropped=tuple(dropped), stopped=run.stopped,
    )  # fmt: skip
