"""From the config of a case to what `jaxobs.tuning.case.run` takes: the free numbers, the objective, the proof, the check."""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import designs
from jaxobs._module import refuse
from jaxobs.cli.parts import Part
from jaxobs.cli.subject import Bounds, Subject
from jaxobs.cli.tune_config import CaseConfig, weight_of
from jaxobs.cli.tune_floor import deviation, floor_of
from jaxobs.cli.tune_free import Space, attribute, nearby
from jaxobs.cli.tune_record import RecordedCase
from jaxobs.designs.polytope import Polytope
from jaxobs.observers import AbstractStepObserver
from jaxobs.studies.family import Family
from jaxobs.tuning import ByCondition5, Linear, Quadratic, error_gain
from jaxobs.tuning.case import SHORT, Case
from jaxobs.tuning.comparison import compare
from jaxobs.tuning.descent import cosine_adam
from jaxobs.tuning.objectives import MonteCarlo, SteadyNoise, Weighted


@dataclasses.dataclass(frozen=True, eq=False)
class Job:
    """A case that is ready to run. prepare: the case with its further starts, which takes a moment, and notes about them;
    finish: a certificate with the proof of its bounds, where there is one; state: the one of the summary, 1 is the first."""

    config: CaseConfig
    case: Case
    state: int
    prepare: Callable[[], tuple[Case, list[str]]]
    finish: Callable[[Any], Any]


def job(config: CaseConfig, name: str) -> Job:
    """ValueError naming the key that does not fit."""
    try:
        return _job(config, name)
    except ValueError as error:
        if config.label:
            error.add_note(f"It is about the case {config.label!r}.")
        raise


def _job(config: CaseConfig, name: str) -> Job:
    if config.world is None:
        plant, observer, around = None, config.observer.build({}, {}), {}
    else:
        plant, observer, around = config.world.study()
        plant = _about_nominal(plant, config.world.plant)
        starts = {key: one(observer.n) if callable(one) else one for key, one in around.items() if key in ("x0", "xhat0")}
        around = {key: starts.get(key, one) for key, one in around.items() if key in AROUND}
    space = Space(observer, config.free)
    proof = _Proof(config, observer)
    if plant is None:
        record = RecordedCase(config)
        loss, keys, check = record.loss(), None, record.check
        headline = record.state
    else:
        loss, keys = _loss(config, plant, observer, around)
        check, headline = _check(config, plant, around), _headline(config, plant)
    search = config.search
    options: dict[str, Any] = {"steps": search.steps, "price": search.price}
    if search.optimizer == "adam":
        options["optimizer"] = cosine_adam(search.learning_rate, search.steps)
    rate = config.certify.rate
    case = Case(name, space.make, space.theta0, loss, proof.certify, check, rate, keys, nearby(search, space), options)

    def prepare() -> tuple[Case, list[str]]:
        if config.search.starts == "none":
            return case, []
        rate = _rate(case, observer)
        start, note = _h2_start(config, space, proof.model, plant, around, rate)
        starts = [*([] if start is None else [start]), *case.starts]
        return dataclasses.replace(case, starts=starts, rate=rate), [note]

    if config.search.starts == "h2" and (proof.model is None or isinstance(observer, AbstractStepObserver) or plant is None):
        fix = "It is that of flow observers with slopes in [bounds]; nearby = 2 starts beside the gain before."
        raise refuse("config", "search.starts", "'h2'", 'kind = "quadratic" and a flow observer', fix)
    return Job(config, case, headline, prepare, proof.finish)


ROOM = 2e-3  # by which the convex design proves more than the rate, so that the search starts inside what is proved
AROUND = ("ts", "x0", "xhat0", "keys", "integrator", "signal", "noise", "disturbance")


class _Proof:
    """What certifies, the error model it is about, and how bounds travel with it."""

    def __init__(self, config: CaseConfig, observer: Any):
        self.config, self.model, self.certify = config, None, None
        model = getattr(observer, "model", None) or getattr(getattr(observer, "phi", None), "model", None)
        self.plant, self.q = model, getattr(observer, "q", 0)
        kind, given = config.certify.kind, config.certify
        if (kind == "quadratic") != (config.bounds is not None):
            fix = "A quadratic proof needs slopes: [bounds] lower and upper; other proofs do not look at them."
            has = "nothing" if config.bounds is None else "a table"
            raise refuse("config", "bounds", has, 'a table with certify.kind = "quadratic" and only then', fix)
        if (kind == "condition5") != (given.lipschitz is not None):
            fix = "It bounds the slope of phi, for condition (5) alone."
            raise refuse("config", "certify.lipschitz", given.lipschitz, 'a number with kind = "condition5"', fix)
        step = isinstance(observer, AbstractStepObserver)
        if kind == "condition5" and given.lipschitz is not None:
            self.certify = ByCondition5(given.lipschitz)
        elif kind == "linear":
            self.certify = Linear(self.plant, step=step)
        elif kind == "quadratic":
            subject = Subject(self.plant, config.bounds)
            self.model = subject.polytope().behind(self.q)
            error_gain(observer)  # ValueError for an observer whose gain is not known
            self.certify = Quadratic(self.model, step=step, cover=given.cover, origin=subject.origin)

    def finish(self, certificate: Any) -> Any:
        """With the proof of the bounds, if they are those of a box."""
        bounds = self.config.bounds
        if certificate is None or bounds is None or bounds.kind != "box":
            return certificate
        return _travel(certificate, bounds, self.plant, self.q)


class _Behind:
    """(eps, x)' of q integrators of y ahead of a plant: the vector field whose Jacobian is `Polytope.behind(q)`."""

    def __init__(self, plant: Any, q: int):
        self.plant, self.q, self.n, self.m = plant, q, plant.n + q, plant.m

    def flow(self, t, z, u):
        x = z[self.q :]
        return jnp.concatenate([z[1 : self.q], self.plant.h(x, u), self.plant.flow(t, x, u)])


def _travel(certificate: Any, bounds: Bounds, plant: Any, q: int) -> Any:
    if q == 0:
        return bounds.travel(certificate, plant)
    far = (float("inf"),) * q
    lower, upper = ((tuple(-x for x in far) + bounds.lower[0],), (far + bounds.upper[0],))
    return dataclasses.replace(bounds, lower=lower, upper=upper).travel(certificate, _Behind(plant, q))


def _about_nominal(plant: Any, part: Part) -> Any:
    """The family of plants about the one that the models are made like: its transient, without noise, is shown."""
    if not isinstance(plant, Family):
        return plant
    centre = plant.observer
    for leaf, one in part.axes():
        if one.nominal is not None:
            value = jnp.asarray(one.nominal, jnp.result_type(float))
            centre = eqx.tree_at(lambda tree, leaf=leaf: functools.reduce(attribute, leaf.split("."), tree), centre, value)
    return dataclasses.replace(plant, observer=centre)


def members(plant: Any) -> list[Any]:
    """The plants of a family, or the one."""
    return [plant.member(*chosen) for chosen in itertools.product(*plant.values)] if isinstance(plant, Family) else [plant]


def _loss(config: CaseConfig, plant: Any, observer: Any, around: dict[str, Any]) -> tuple[Any, Any]:
    """(loss(observer, key), keys)."""
    asked, several = config.objective, members(plant)
    n, weight = several[0].n, jnp.asarray(weight_of(config, several[0].n))
    points = jnp.zeros((1, n)) if asked.points is None else jnp.asarray(np.array(asked.points))
    inputs = None if asked.inputs is None else jnp.asarray(np.array(asked.inputs))
    if asked.kind == "monte_carlo":
        x0, xhat0 = (np.asarray(around[name], float) for name in ("x0", "xhat0"))
        x0, xhat0 = (one[0] if one.ndim == 2 else one for one in (x0, xhat0))
        runs = {name: around[name] for name in ("ts", "noise", "disturbance", "signal", "integrator")}
        spread = None if asked.spread is None else jnp.asarray(np.array(asked.spread))
        loss = MonteCarlo(plant, x0=x0, xhat0=xhat0, after=asked.after, spread=spread, weight=weight, **runs)
        keys = jax.random.split(jax.random.key(asked.key), asked.seeds)
    else:
        step = isinstance(observer, AbstractStepObserver)
        more = {} if step else {"dt": _period(around["ts"]), "process_held": True}
        disturbance = around["disturbance"]
        more |= {"process": None if disturbance is None else deviation(disturbance, "disturbance"), "inputs": inputs}
        more |= {"noise": deviation(around["noise"], "noise"), "weight": weight, "with_bias": asked.with_bias}
        loss = _over_plants([SteadyNoise(one, points, **more) for one in several])
        keys = None
    if asked.fastest is not None:
        model = getattr(observer, "model", several[0])
        loss = Weighted((loss,), None, asked.fastest, model, points, inputs)
    return loss, keys


def _over_plants(terms: list[Any]) -> Any:
    """The root of the mean square over plants, side by side: compiled once for all of them."""
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *terms)

    def loss(observer: Any, key: Any = None) -> Any:
        values = eqx.filter_vmap(lambda term: term(observer), in_axes=(eqx.if_array(0),))(stacked)
        return jnp.sqrt(jnp.mean(values**2))

    return terms[0] if len(terms) == 1 else loss


def _period(ts: Any) -> float:
    return float((ts[-1] - ts[0]) / (len(ts) - 1))


def _headline(config: CaseConfig, plant: Any) -> int:
    """The state of the summary: that of the objective, if it is shown."""
    n, states = members(plant)[0].n, config.check.states
    heaviest = int(np.argmax(weight_of(config, n))) + 1
    return heaviest if states is None or heaviest in states else states[0]


def _check(config: CaseConfig, plant: Any, around: dict[str, Any]) -> Callable[[Any], Any]:
    asked = config.check
    if asked.floor != "none":  # refused here rather than after the search
        for name in ("noise", "disturbance"):
            deviation(around[name], name)

    def check(observers: Any) -> Any:
        dt = _period(around["ts"])
        floor = None if asked.floor == "none" else floor_of(asked.floor, members(plant), around, dt, asked.after)
        runs = {name: around[name] for name in AROUND}
        states = None if asked.states is None else list(asked.states)
        return compare(observers, plant, after=asked.after, state=states, band=asked.band, floor=floor, **runs)

    return check


def _rate(case: Case, observer: Any) -> float:
    """As `run` takes it: a thousandth below the largest of the gain before."""
    if case.rate is not None or case.certify is None:
        return case.rate or 0.0
    largest = case.certify.start(observer, 0.0).rate
    if not 0 < largest < np.inf:
        fix = "Give certify.rate, or start from another gain."
        raise designs.Infeasible(f"the gain before proves no decay: {largest:.6g} 1/s at best", largest, fix)
    return largest * (1 - SHORT)


def _h2_start(
    config: CaseConfig, space: Space, model: Polytope | None, plant: Any, around: dict[str, Any], rate: float
) -> tuple[Any, str]:
    """The theta of the gain with the least guaranteed noise, and a sentence about it."""
    first, dt = members(plant)[0], _period(around["ts"])
    if model is None:
        return None, ""
    q = model.n - first.n
    e, sigma = np.asarray(first.disturbance_matrix(), float), deviation(around["disturbance"], "disturbance")
    process = np.pad(e * sigma * np.sqrt(dt), ((q, 0), (0, 0)))
    noise = deviation(around["noise"], "noise") * np.sqrt(dt) * np.eye(first.p)
    weight = np.diag(weight_of(config, first.n))
    weight = np.pad(weight[np.any(weight != 0, axis=1)], ((0, 0), (q, 0)))
    try:
        found = designs.synthesize(model, objective=designs.H2(weight, process, noise), rate=rate * (1 + ROOM))
    except designs.Infeasible as error:
        return None, f"the convex design has no gain at this rate: {error.reason}"
    values = space.values_of(space.observer)
    if "gain" in values:
        values["gain"] = found.gain
    elif "alphas" in values:
        values["alphas"] = found.gain[:, 0] / float(space.observer.gamma) ** np.arange(1, model.n + 1)
    else:
        return None, "the convex design's gain has no place among the free numbers: alphas or gain"
    try:
        return space.encode(values), f"start 1 is the convex design: sqrt of its guaranteed mean square {found.norm:.4g}"
    except ValueError as error:
        return None, f"the convex design's gain lies outside the charts: {error}"
