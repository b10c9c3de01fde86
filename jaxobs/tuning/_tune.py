"""Gains by gradient, with a proof at the end: descent inside the set of what is certified."""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from jaxobs._module import check, require_integer
from jaxobs.designs import Infeasible
from jaxobs.tuning._checks import require_arguments, require_dependence, require_finite_loss
from jaxobs.tuning._feasible import Candidate, first_candidates
from jaxobs.tuning.certifiers.base import AbstractCertifier
from jaxobs.tuning.descent import Search, State, backtracking_lbfgs
from jaxobs.tuning.history import History, joined
from jaxobs.tuning.tuned import Tuned

WEIGHTS = (1e-1, 1e-2, 1e-3, 1e-4)  # of the barrier against the loss, both of size one: the last leaves about 0.01 % unused
BLOCK = 20  # steps between two looks: at progress, at Ctrl-C, at whether to stop
SETTLED = 1e-6  # relative: less than that over two blocks ends a stage


class Progress(NamedTuple):
    """Where a search is: the stage of `stages`, steps done of at most `steps`, the least loss so far."""

    stage: int
    stages: int
    step: int
    steps: int
    loss: float


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
    Ctrl-C ends the search; the best so far is proved and returned. progress: called after every 20 steps.

    Infeasible where no start could be moved to prove the rate; its `best` is the nearest rate that was. ValueError in float32,
    for a theta without numbers, a loss that is not finite at a start (it names start and key) or does not depend on a part of
    theta. Source: Boyd and Vandenberghe, Convex Optimization, chapter 11 (barrier, phase one).
    """
    thetas, rate = require_arguments(theta0, starts, certify, rate)
    require_integer("tune", "steps", steps, 1, "It counts the steps of a stage.")
    make = eqx.filter_jit(make)
    mean = _mean(make, loss, keys)
    for i, theta in enumerate(thetas):
        check(make(theta))
        require_finite_loss(mean, theta, i)
    require_dependence(lambda theta: mean(theta)[0], thetas[0])
    first_loss, lanes = float(mean(thetas[0])[0]), 1 if keys is None else len(keys)
    optimizer = backtracking_lbfgs() if optimizer is None else optimizer
    if certify is None:
        run = _Run(mean, make, None, rate, optimizer, steps, progress)
        candidates = [Candidate(i, theta, (), (), False) for i, theta in enumerate(thetas)]
        found = run.descend(candidates, (0.0,))
        best = min(found, key=lambda one: one.loss)
        return _tuned(best, None, run, run.history(lanes), make, first_loss, None, ())
    ready, dropped = first_candidates(make, thetas, certify, rate)
    run = _Run(mean, make, certify, rate, optimizer, steps, progress)
    found = run.descend(ready, WEIGHTS)
    found += [_End(float(mean(one.theta)[0]), one.start, one.theta, one.fixed, one.free, one.repaired) for one in ready]
    best, certificate = _proved(found, make, certify, rate)
    free_loss = None
    history = run.history(lanes)
    if price and not run.stopped:
        free_loss = min([best.loss, *(end.loss for end in run.descend(ready, (0.0,)))])
    return _tuned(best, certificate, run, history, make, first_loss, free_loss, dropped)


class _End(NamedTuple):
    """The best iterate of a stage."""

    loss: float
    start: int
    theta: Any
    fixed: Any
    free: Any
    repaired: bool


class _Run:
    """The stages of one search."""

    def __init__(self, mean, make, certify, rate, optimizer, steps, progress):
        self.mean, self.make, self.certify, self.rate = mean, make, certify, rate
        self.steps, self.progress, self.stopped = steps, progress, False
        self.parts: list[dict[str, Any]] = []
        self.seconds, self.compile_seconds = 0.0, 0.0
        self.search = Search(self.total, optimizer)

    def total(self, variables: Any, arg: Any, weight: Any) -> tuple[Any, Any]:
        """loss / its size + weight * barrier, and what is recorded; weight 0 is the search without a proof."""
        (theta, free), (fixed, scale) = variables, arg
        value, lane = self.mean(theta)
        certify, depth = self.certify, jnp.zeros_like(value)
        if certify is not None:
            rate = jnp.asarray(self.rate, value.dtype)
            depth = jax.lax.cond(
                weight > 0, lambda: certify.barrier(self.make(theta), fixed, free, rate), lambda: jnp.zeros_like(value)
            )
        return value / scale + weight * depth, (value, jax.lax.stop_gradient(depth), lane, theta)

    def descend(self, candidates: list[Candidate], weights: tuple[float, ...]) -> list[_End]:
        begun = time.perf_counter()
        fixed = _stack([one.fixed for one in candidates])
        variables, ends = _stack([(one.theta, one.free) for one in candidates]), []
        losses = np.array([float(self.mean(one.theta)[0]) for one in candidates])
        for stage, weight in enumerate(weights):
            scale = jnp.asarray(np.maximum(np.abs(losses), 1e-300))
            state = self._stage(self.search.begin(variables), (fixed, scale), stage, len(weights), weight)
            reached = np.isfinite(np.asarray(state.value))
            variables = state.best
            for i, one in enumerate(candidates):
                theta, free = jax.tree.map(lambda a, i=i: a[i], variables)
                if reached[i]:
                    losses[i] = float(self.mean(theta)[0])
                    ends.append(_End(losses[i], one.start, theta, one.fixed, free, one.repaired))
            if self.stopped:
                break
        self.seconds += time.perf_counter() - begun
        return ends

    def _stage(self, state: State, args: Any, stage: int, stages: int, weight: float) -> State:
        """Blocks of steps until they change nothing, or the steps are used up."""
        done, before, block = 0, [], min(BLOCK, self.steps)  # whole blocks: another length would be compiled again
        try:
            while done < self.steps:
                begun = time.perf_counter()
                state, record = self.search.run(state, args, block, jnp.asarray(weight))
                values = np.asarray(state.value)
                if not self.parts:
                    self.compile_seconds = time.perf_counter() - begun
                self._keep(record, weight)
                done += block
                if self.progress is not None:
                    least = float(np.min(np.where(self.parts[-1]["good"], self.parts[-1]["loss"], np.inf)))
                    self.progress(Progress(stage, stages, done, self.steps, least))
                before.append(values)
                if len(before) > 2 and np.all(before[-3] - values <= SETTLED * np.maximum(np.abs(values), 1e-300)):
                    break
        except KeyboardInterrupt:
            self.stopped = True
        return state

    def _keep(self, record: Any, weight: float) -> None:
        loss, depth, lane, theta = record.parts
        paths = jax.tree_util.tree_flatten_with_path(theta)[0]
        self.parts.append(
            {
                "loss": np.asarray(loss), "barrier": np.where(weight > 0, depth, np.nan), "slope": np.asarray(record.slope),
                "good": np.asarray(record.good), "lane": np.asarray(lane), "weight": np.full(loss.shape[1], weight),
                "theta": {jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in paths},
            }
        )  # fmt: skip

    def history(self, lanes: int) -> History:
        count = sum(part["loss"].size for part in self.parts) * lanes
        return joined(self.parts, calls=count, seconds=self.seconds, compile_seconds=self.compile_seconds)


def _mean(make: Any, loss: Any, keys: Any) -> Any:
    """theta -> (mean over the keys, the first key whose loss is not finite or -1), compiled."""

    def mean(theta: Any) -> tuple[Any, Any]:
        observer = make(theta)
        if keys is None:
            value = jnp.asarray(loss(observer, None))
            return value, jnp.where(jnp.isfinite(value), -1, 0)
        values = jax.vmap(lambda key: loss(observer, key))(keys)
        bad = ~jnp.isfinite(values)
        return jnp.mean(values), jnp.where(jnp.any(bad), jnp.argmax(bad), -1)

    return jax.jit(mean)


def _proved(found: list[_End], make: Any, certify: AbstractCertifier, rate: float) -> tuple[_End, Any]:
    """The least loss that passes the exact check."""
    refused = None
    for end in sorted(found, key=lambda one: one.loss):
        try:
            return end, certify.prove(make(end.theta), end.fixed, end.free, rate)
        except Infeasible as error:
            refused = error
    assert refused is not None
    raise refused


def _tuned(best, certificate, run, history, make, first_loss, free_loss, dropped) -> Tuned:
    return Tuned(
        observer=make(best.theta), certificate=certificate, history=history, theta=best.theta, loss=best.loss,
        first_loss=first_loss, free_loss=free_loss, rate=run.rate, unit="1/s" if run.certify is None else run.certify.unit,
        start=best.start, repaired=(best.start,) if best.repaired else (), dropped=tuple(dropped), stopped=run.stopped,
    )  # fmt: skip


def _stack(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *trees)
