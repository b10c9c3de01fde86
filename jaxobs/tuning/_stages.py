"""The stages of a search: blocks of steps, the barrier's weight falling, several candidates side by side."""

import functools
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.flatten_util import ravel_pytree

from jaxobs.designs import Infeasible
from jaxobs.tuning._feasible import Candidate, recentred
from jaxobs.tuning.certifiers.base import AbstractCertifier
from jaxobs.tuning.descent import Search, backtracking_lbfgs
from jaxobs.tuning.history import History, joined

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


class End(NamedTuple):
    """The best iterate of a candidate in a stage, and its loss."""

    loss: float
    candidate: Candidate


class Stages:
    """One search; a candidate's loss is sum_i mix_i (mean of losses[i] over the keys)."""

    def __init__(
        self,
        mean: Any,
        make: Callable[[Any], Any],
        certify: AbstractCertifier | None,
        optimizer: optax.GradientTransformation | None,
        steps: int,
        progress: Callable[[Progress], None] | None,
    ):
        self.mean, self.make, self.certify = mean, make, certify
        self.steps, self.progress, self.stopped = steps, progress, False
        self.parts: list[dict[str, Any]] = []
        self.seconds, self.compile_seconds = 0.0, 0.0
        self.unravel: Callable[[Any], Any] = lambda x: x  # of a flat x into (theta, free), once candidates are known
        self.search = Search(self.total, backtracking_lbfgs() if optimizer is None else optimizer)

    def total(self, moved: Any, arg: Any, weight: Any) -> tuple[Any, Any]:
        """loss / its size + weight * barrier at x = origin + metric moved, and what is recorded; weight 0: without a proof."""
        origin, metric, fixed, rate, mix, scale = arg
        theta, free = self.unravel(origin + metric @ moved)
        values, lane = self.mean(theta)
        value = jnp.sum(mix * values)
        certify, depth = self.certify, jnp.zeros_like(value)
        if certify is not None:
            depth = jax.lax.cond(
                weight > 0, lambda: certify.barrier(self.make(theta), fixed, free, rate), lambda: jnp.zeros_like(value)
            )
        return value / scale + weight * depth, (value, jax.lax.stop_gradient(depth), lane, theta)

    @functools.cached_property
    def metric(self) -> Any:
        """(x, fixed, rate, weight) -> (1 + weight |H|)^-1/2, H the Hessian of the barrier at x: in these coordinates the search
        is conditioned alike however thin what is proved becomes. |H| by its eigenvalues, since the joint problem is not convex.
        """

        certify = self.certify
        assert certify is not None  # without one the metric is not asked for

        def one(x: Any, fixed: Any, rate: Any, weight: Any) -> Any:
            def depth(x: Any) -> Any:
                theta, free = self.unravel(x)
                return certify.barrier(self.make(theta), fixed, free, rate)

            hessian = jax.hessian(depth)(x)
            good = jnp.all(jnp.isfinite(hessian))
            values, vectors = jnp.linalg.eigh(jnp.where(good, hessian, jnp.zeros_like(hessian)))
            return (vectors / jnp.sqrt(1 + weight * jnp.abs(values))) @ vectors.T

        return jax.jit(jax.vmap(one, in_axes=(0, 0, 0, None)))

    def loss(self, one: Candidate) -> float:
        return float(np.dot(one.mix, np.asarray(self.mean(one.theta)[0])))

    def descend(self, candidates: Sequence[Candidate], weights: tuple[float, ...]) -> list[End]:
        """The ends of every stage, of those candidates that came somewhere."""
        begun = time.perf_counter()
        now, ends = list(candidates), []
        for stage, weight in enumerate(weights):
            if self.certify is not None:
                now = [recentred(self.certify, one) for one in now]
            fixed, rate, mix = _stack([(one.fixed, one.rate, np.asarray(one.mix, float)) for one in now])
            scale = jnp.asarray([max(abs(self.loss(one)), 1e-300) for one in now])
            flat = [ravel_pytree((one.theta, one.free)) for one in now]
            self.unravel = flat[0][1]
            x = jnp.stack([one for one, _ in flat])
            x, values = self._stage(x, (fixed, rate, mix, scale), stage, len(weights), weight)
            for i in np.flatnonzero(np.isfinite(values)):
                theta, free = self.unravel(x[i])
                now[i] = now[i]._replace(theta=theta, free=free)
                ends.append(End(self.loss(now[i]), now[i]))
            if self.stopped:
                break
        self.seconds += time.perf_counter() - begun
        return ends

    def _stage(self, x: Any, args: Any, stage: int, stages: int, weight: float) -> tuple[Any, np.ndarray]:
        """(the best x, its total): blocks of steps, each in its own metric, until they change nothing or are used up."""
        done, block = 0, min(BLOCK, self.steps)  # whole blocks: another length would be compiled again
        before, values, asked = [], np.full(len(x), np.inf), jnp.asarray(weight)
        identity = jnp.broadcast_to(jnp.eye(x.shape[1]), (len(x), x.shape[1], x.shape[1]))
        try:
            while done < self.steps:
                begun = time.perf_counter()
                metric = identity if self.certify is None or weight == 0 else self.metric(x, *args[:2], asked)
                state, record = self.search.run(self.search.begin(jnp.zeros_like(x)), (x, metric, *args), block, asked)
                values = np.asarray(state.value)
                x = jnp.where(np.isfinite(values)[:, None], x + jnp.einsum("sij,sj->si", metric, state.best), x)
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
            if not self.parts:
                raise  # nothing was searched yet
            self.stopped = True
        return x, values

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


def means(make: Any, losses: Sequence[Any], keys: Any) -> Any:
    """theta -> (means over the keys (losses,), the first key with a loss that is not finite or -1), compiled."""

    def mean(theta: Any) -> tuple[Any, Any]:
        observer = make(theta)
        if keys is None:
            values = jnp.stack([jnp.asarray(loss(observer, None)) for loss in losses])
            return values, jnp.where(jnp.all(jnp.isfinite(values)), -1, 0)
        values = jax.vmap(lambda key: jnp.stack([jnp.asarray(loss(observer, key)) for loss in losses]))(keys)
        bad = ~jnp.all(jnp.isfinite(values).reshape(len(keys), -1), axis=1)
        return jnp.mean(values, axis=0), jnp.where(jnp.any(bad), jnp.argmax(bad), -1)

    return jax.jit(mean)


def proved(found: Sequence[End], make: Any, certify: AbstractCertifier) -> tuple[End, Any]:
    """The least loss that passes the exact check, and its certificate. Infeasible if none does."""
    refused = None
    for end in sorted(found, key=lambda one: one.loss):
        one = end.candidate
        try:
            return end, certify.prove(make(one.theta), one.fixed, one.free, one.rate)
        except Infeasible as error:
            refused = error
    assert refused is not None
    raise refused


def _stack(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *trees)
