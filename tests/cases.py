"""One line for each public class: how to build a small one in a given precision; and what each kind of object is asked.

A new plant, signal, noise, integrator, observer or metric takes one line in CASES, which buys tests/test_contract.py.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import integrators, metrics, noise, observers, plants, signals
from jaxobs._module import Module

PACKAGES = [plants, signals, noise, integrators, observers, metrics]
DT = 0.1


def swing(x, u, c):
    return [x[1] + c["bend"] * x[0] ** 3, -jnp.sin(x[0]) + u[0] * x[1]]


def swing_seen(x, u, c):
    return x[0]


def swing_step(x, u, c):
    return x + DT * jnp.stack(swing(x, u, c))


def swinging(f):
    return plants.from_function(swing, swing_seen, n=2, m=1, parameters={"bend": f(0.3)})


# fmt: off
CASES: dict[str, Callable[[Callable[[Any], jax.Array]], Module]] = {  # f makes an array of the precision asked for
    "BlockTriangularOf": lambda f: plants.BlockTriangularOf(plants.Hovercraft(f(0.7)), (0, 1, 2, 3, 4), (2, 2, 1)),
    "ChainOf": lambda f: plants.ChainOf(plants.Pendulum(f(1.2), f(0.3)), (0, 1)),
    "Discretised": lambda f: plants.Discretised(plants.Pendulum(f(1.2), f(0.3)), integrators.Euler(), f(DT)),
    "Duffing": lambda f: plants.Duffing(f(1.1), f(0.7)),
    "FieldMotor": lambda f: plants.FieldMotor(f(1.0), f(0.4), f(1.1), f(0.5), f(0.2), f(0.6), f(0.1)),
    "FlowFunction": lambda f: swinging(f),
    "FlexibleJoint": lambda f: plants.FlexibleJoint(
        f(0.7), f(1.3), f(0.5), f(0.8), f(0.4), f(0.6), f(1.1), f(0.9), f(9.8)),
    "ForcedDuffing": lambda f: plants.ForcedDuffing(f(0.3)),
    "GatedChain": lambda f: plants.GatedChain(),
    "Hovercraft": lambda f: plants.Hovercraft(f(0.7)),
    "IntegratorChain": lambda f: plants.IntegratorChain(3),
    "LearnedField": lambda f: plants.LearnedField(
        f([[0.5, -0.2], [0.1, 0.9]]), f([0.1, -0.3]), f([2.0, -1.0]), f([0.2, 0.0]), f([1.0, 2.0]), f(DT)),
    "Lienard": lambda f: plants.Lienard(f(1.3)),
    "Linear": lambda f: plants.Linear(f([[0.0, 1.0], [-2.0, -0.3]]), f([[0.0], [1.5]]), f([[1.0, 0.2]])),
    "LinearStep": lambda f: plants.LinearStep(f([[0.9, 0.1], [-0.2, 0.8]]), f([[0.0], [0.1]]), f([[1.0, 0.0]])),
    "LipschitzOf": lambda f: plants.LipschitzOf(plants.Duffing(f(1.1), f(0.7)), (1,), (), ((0, 1),)),
    "Lorenz": lambda f: plants.Lorenz(f(10), f(28), f(2.5)),
    "NormalChain": lambda f: plants.NormalChain(plants.Lienard(f(1.3)), f([0.0, 0.0])),
    "NormalTriangular": lambda f: plants.NormalTriangular(swinging(f), f([0.0, 0.0])),
    "Pendulum": lambda f: plants.Pendulum(f(1.2), f(0.3)),
    "Rossler": lambda f: plants.Rossler(f(0.3), f(0.2), f(5.0), f([[0.0, 1.0, 0.0], [0.5, 0.0, 1.0]])),
    "SampledChain": lambda f: plants.SampledChain(3, f(DT)),
    "Saturated": lambda f: plants.Saturated(
        plants.Lorenz(f(10), f(28), f(2.5)), f([-0.5, -0.4, 0.0]), f([0.6, 0.5, 0.8])),
    "SineChain": lambda f: plants.SineChain(f(0.9), 3),
    "StateAffineOf": lambda f: plants.StateAffineOf(plants.Linear(f([[0.0, 1.0], [-2.0, -0.3]]), f([[0.0], [1.5]]))),
    "StepFunction": lambda f: plants.from_step_function(swing_step, swing_seen, n=2, m=1, parameters={"bend": f(0.3)}),
    "SwingingLeg": lambda f: plants.SwingingLeg(f(9.0), f(0.4), f(0.6), f(-0.2)),
    "TriangularOf": lambda f: plants.TriangularOf(plants.Lienard(f(1.3)), (0, 1)),
    "VanDerPol": lambda f: plants.VanDerPol(f(1.3)),
    "VanDerPolSeen": lambda f: plants.VanDerPolSeen(f(1.3), f([[0.0, 1.0]])),
    "WithTones": lambda f: plants.WithTones(plants.SampledChain(2, f(DT)), f([2.0, 0.7]), f([0.1, 0.0]), f(DT)),

    "Held": lambda f: signals.Held(f([0.0, 0.45, 1.05]), f([[1.0, 2.0], [3.0, -1.0], [0.5, 0.0]])),
    "Recorded": lambda f: signals.Recorded(f([0.0, 0.45, 1.05]), f([[1.0, 2.0], [3.0, -1.0], [0.5, 0.0]])),
    "Sine": lambda f: signals.Sine(f(0.5), f(2.0), f(0.3), f(1.0)),
    "Sine with derivatives": lambda f: signals.Sine(f(0.5), f(2.0), f(0.3), f(1.0), order=2),
    "Zero": lambda f: signals.Zero(2),

    "Bias": lambda f: noise.Bias(f(0.3)),
    "Dropout": lambda f: noise.Dropout(f(0.4)),
    "Gaussian": lambda f: noise.Gaussian(f(0.2)),
    "Outliers": lambda f: noise.Outliers(f(0.4), f(3.0)),
    "Silent": lambda f: noise.Silent(),
    "Sinusoid": lambda f: noise.Sinusoid(f(0.5), f(3.0), f(0.2)),
    "Sum": lambda f: noise.Sum((noise.Gaussian(f(0.2)), noise.Bias(f(0.3)), noise.Dropout(f(0.4)))),
    "Uniform": lambda f: noise.Uniform(f(0.2)),

    "Adaptive": lambda f: integrators.Adaptive(rtol=1e-10, atol=1e-12),
    "Euler": lambda f: integrators.Euler(substeps=2),
    "Exponential": lambda f: integrators.Exponential(substeps=2),
    "RK4": lambda f: integrators.RK4(substeps=2),

    "Algebraic": lambda f: observers.Algebraic(
        observers.DuffingRoot(plants.Duffing(f(1.1), f(0.7))), observers.Tracker(3, 1, f(4.0), f(0.2))),
    "ContinuousDiscreteKalman": lambda f: observers.ContinuousDiscreteKalman(
        plants.VanDerPol(f(1.3)), f([[0.4]]), f([[0.2]]), f([[1.0, 0.3], [0.3, 2.0]]), f(DT), integrators.RK4(), 2),
    "ContinuousKalman": lambda f: observers.ContinuousKalman(
        plants.Pendulum(f(1.2), f(0.3)), f([[0.4]]), f([[0.2]]), f([[1.0, 0.3], [0.3, 2.0]])),
    "CurrentLuenberger": lambda f: observers.CurrentLuenberger(plants.SampledChain(2, f(DT)), f([[0.4], [0.9]])),
    "DiscreteAlgebraic": lambda f: observers.DiscreteAlgebraic(
        observers.DuffingRational(plants.Duffing(f(1.1), f(0.7))), observers.DiscreteTracker(3, 0, f(4.0), f(DT), f(0.2))),
    "DiscreteKalman": lambda f: observers.DiscreteKalman(
        plants.Discretised(plants.Pendulum(f(1.2), f(0.3)), integrators.Euler(), f(DT)),
        f([[0.4]]), f([[0.2]]), f([[1.0, 0.3], [0.3, 2.0]])),
    "DiscreteTracker": lambda f: observers.DiscreteTracker(2, 1, f(4.0), f(DT), f(0.2)),
    "DiscreteTracker steady": lambda f: observers.DiscreteTracker(3, 0, f(4.0), f(DT)),
    "DiscreteTracker matrix": lambda f: observers.DiscreteTracker(1, 1, f(4.0), f(DT), f([[1.0, 0.3], [0.3, 0.5]])),
    "DuffingRational": lambda f: observers.DuffingRational(plants.Duffing(f(1.1), f(0.7))),
    "DuffingRoot": lambda f: observers.DuffingRoot(plants.Duffing(f(1.1), f(0.7))),
    "HighGain": lambda f: observers.HighGain(plants.Pendulum(f(1.2), f(0.3)), f([1.5, 1.0]), f(3.0)),
    "InnerInjection": lambda f: observers.InnerInjection(
        plants.Lorenz(f(10), f(28), f(2.5)), f([[0.5], [2.0], [0.1]]), f([[0.0], [1.0], [0.2]])),
    "IntegralHighGain": lambda f: observers.IntegralHighGain(plants.VanDerPol(f(1.3)), f([4.0, 6.0, 4.0, 1.0]), f(2.0), 2),
    "IntegralHighGain q=0": lambda f: observers.IntegralHighGain(plants.VanDerPol(f(1.3)), f([1.5, 1.0]), f(2.0), 0),
    "Luenberger": lambda f: observers.Luenberger(plants.Lorenz(f(10), f(28), f(2.5)), f([[0.5], [2.0], [0.1]])),
    "OutputInjection": lambda f: observers.OutputInjection(plants.VanDerPol(f(1.3)), f([[1.5], [1.0]])),
    "PulledBack": lambda f: observers.PulledBack(
        observers.HighGain(plants.NormalChain(plants.Lienard(f(1.3)), f([0.0, 0.0])), f([1.5, 1.0]), f(3.0))),
    "PulledBack q=1": lambda f: observers.PulledBack(observers.IntegralHighGain(
        plants.NormalChain(plants.Lienard(f(1.3)), f([0.0, 0.0])), f([3.0, 3.0, 1.0]), f(2.0), 1)),
    "PulledBack gain": lambda f: observers.PulledBack(
        observers.Luenberger(plants.NormalTriangular(swinging(f), f([0.0, 0.0])), f([[1.5], [1.0]]))),
    "RationalMap": lambda f: observers.RationalMap(
        plants.GatedChain(), 1, 0, (((1, 0, 0),), ((0, 0, 0),), ((0, 1, 0),), ((0, 0, 1),)), f([1.0, 1.0, 1.0, 1.0])),
    "Lyapunov": lambda f: observers.Lyapunov(
        plants.FieldMotor(f(1.0), f(0.4), f(1.1), f(0.5), f(0.2), f(0.6), f(0.1)), f(3.0), f(0.5)),
    "Lyapunov blocks": lambda f: observers.Lyapunov(plants.Hovercraft(f(0.7)), f(3.0), f(1.0)),
    "Sampled": lambda f: observers.Sampled(
        observers.HighGain(plants.Pendulum(f(1.2), f(0.3)), f([1.5, 1.0]), f(3.0)), integrators.Exponential(), f(DT)),
    "StepIntegral": lambda f: observers.StepIntegral(plants.VanDerPol(f(1.3)), f([0.4, 0.3, 0.2, 0.1]), f(DT), 2),
    "StepIntegral q=0": lambda f: observers.StepIntegral(plants.VanDerPol(f(1.3)), f([0.4, 0.3]), f(DT), 0),
    "StepLyapunov": lambda f: observers.StepLyapunov(
        plants.FieldMotor(f(1.0), f(0.4), f(1.1), f(0.5), f(0.2), f(0.6), f(0.1)), f(3.0), f(DT), f(0.5)),
    "StepLyapunov state-affine": lambda f: observers.StepLyapunov(
        plants.GatedChain(), f(3.0), f(DT), f([[0.5, 0.1], [0.1, 1.0]])),
    "StepLyapunov blocks": lambda f: observers.StepLyapunov(plants.Hovercraft(f(0.7)), f(3.0), f(DT), f(1.0)),
    "StepLuenberger": lambda f: observers.StepLuenberger(
        plants.Discretised(plants.Pendulum(f(1.2), f(0.3)), integrators.Euler(), f(DT)), f([[0.4], [0.3]])),
    "Tracker": lambda f: observers.Tracker(2, 1, f(4.0), f(0.2)),
    "Tracker diagonal": lambda f: observers.Tracker(2, 0, f(4.0), f([0.2, 0.7])),
    "Tracker q=0": lambda f: observers.Tracker(3, 0, f(4.0), f(0.2)),

    "Consistency": lambda f: metrics.Consistency(f(0.5), f(0.15)),
    "NoiseGain": lambda f: metrics.NoiseGain(f(0.5), f(0.15)),
    "Peak": lambda f: metrics.Peak(),
    "RMSE": lambda f: metrics.RMSE(f(0.15)),
    "SettlingTime": lambda f: metrics.SettlingTime(f(0.3)),
    "Whiteness": lambda f: metrics.Whiteness(2),
}
# fmt: on


def build(label: str, dtype: Any = np.float64) -> Module:
    return CASES[label](lambda value: jnp.asarray(value, dtype))


def inputs(thing: Any, dtype: Any = np.float64) -> dict[str, jax.Array]:
    """What `work` feeds to an object of this kind: random numbers of its sizes."""
    rng = np.random.default_rng(0)
    t = {"t": np.asarray(0.3)}
    match thing:
        case plants.AbstractPlant():
            given = t | {"x": rng.normal(size=thing.n), "u": rng.normal(size=thing.m)}
        case signals.AbstractSignal():
            given = {"ts": np.asarray([-0.2, 0.3, 0.6, 1.4])}
        case noise.AbstractNoise():
            given = {"ts": np.arange(6) * DT}
        case integrators.AbstractIntegrator():
            given = t | {"vector": rng.normal(size=2), "scalar": rng.normal(size=())}
        case observers.AbstractAlgebraicMap():
            given = {"y": rng.normal(size=thing.order + 1), "u": rng.normal(size=(thing.model.m, thing.input_order + 1))}
        case observers.AbstractObserver():
            y, u = rng.normal(size=(3, thing.p)), rng.normal(size=(3, thing.m))
            given = t | {"xhat0": rng.normal(size=thing.n), "y": y, "u": u}
        case metrics.AbstractMetric():
            error = rng.normal(size=(6, 2)) * np.asarray([2.0, 1.0, 0.5, 0.2, 0.1, 0.05])[:, None]
            x, innovation = rng.normal(size=(6, 2)), rng.normal(size=(6, 1))
            given = {"t": np.arange(6) * DT, "x": x, "xhat": x + error, "innovation": innovation}
    return {name: jnp.asarray(value, dtype) for name, value in given.items()}


@functools.singledispatch
def work(thing: Any, given: dict[str, jax.Array]) -> dict[str, Any]:
    """Every method of the object's contract, on the given numbers."""
    raise NotImplementedError(f"tests/cases.py: nothing is asked of {type(thing).__name__}")


@work.register
def _(plant: plants.AbstractFlowPlant, given):
    t, x, u = given["t"], given["x"], given["u"]
    split = {"split": plant.split(t, x, u)} if hasattr(plant, "split") else {}
    return {"flow": plant.flow(t, x, u), "h": plant.h(x, u), "disturbance": plant.disturbance_matrix(), **split}


@work.register
def _(plant: plants.AbstractStepPlant, given):
    x, u = given["x"], given["u"]
    return {"step": plant.step(jnp.asarray(3), x, u), "h": plant.h(x, u), "disturbance": plant.disturbance_matrix()}


@work.register
def _(signal: signals.AbstractSignal, given):
    return {"u": jax.vmap(signal)(given["ts"])}


@work.register
def _(source: noise.AbstractNoise, given):
    w, valid = source.sample(jax.random.key(0), given["ts"], 2)
    return {"w": w, "valid": valid}


@work.register
def _(integrator: integrators.AbstractIntegrator, given):
    """z' = A z + b(t, z) in the plane beside w' = cos t - w z_1, which has no linear part to take exactly."""
    a = jnp.asarray([[0.0, 1.0], [-4.0, -3.0]], given["vector"].dtype)

    def rest(t, z, w):
        return jnp.stack([jnp.sin(z[1]), jnp.cos(t) * w]), jnp.cos(t) - w * z[0]

    def flow(t, state):
        z, w = state
        b, dw = rest(t, z, w)
        return a @ z + b, dw

    field = integrators.Field(flow, lambda t, state: ((a, None), rest(t, *state)))
    state, dt = (given["vector"], given["scalar"]), jnp.full_like(given["t"], DT)
    return {"z": integrator.step(field, integrator.prepare(field, dt, state), given["t"], dt, state)}


@work.register
def _(phi: observers.AbstractAlgebraicMap, given):
    y, u = given["y"], given["u"]
    slope = observers.sensitivity(phi, y, u)
    return {"state": phi.state(y, u), "denominators": phi.denominators(y, u), "sensitivity": slope}


@work.register
def _(observer: observers.AbstractStepObserver, given):
    def body(z, sample):
        k, u, y = sample
        return observer.step(k, z, u, y), (observer.estimate(k, z, u, y), observer.predict(k, z, u))

    z, (xhat, expected) = jax.lax.scan(body, observer.init(given["xhat0"]), (jnp.arange(3), given["u"], given["y"]))
    return {"xhat": xhat, "predict": expected, "z": z}


@work.register
def _(observer: observers.AbstractFlowObserver, given):
    t, u, y = given["t"], given["u"][0], given["y"][0]
    z = observer.init(given["xhat0"])
    split = {"split": observer.split(t, z, u, y)} if hasattr(observer, "split") else {}
    sampled = observers.Sampled(observer, integrators.Euler(), jnp.full_like(t, DT))
    return {"flow": observer.flow(t, z, u, y), **split, **work(sampled, given)}


@work.register
def _(metric: metrics.AbstractMetric, given):
    valid = jnp.asarray([True, True, False, True, True, True])[:, None]
    moments = metrics.Moment(given["t"], given["x"], given["xhat"], given["innovation"], valid)
    start = metric.init(2, 1, given["x"].dtype)
    return {"result": metric.result(jax.lax.scan(lambda s, moment: (metric.update(s, moment), None), start, moments)[0])}
