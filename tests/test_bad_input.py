"""A bad argument is refused at construction, naming class, field, given and expected; traced values are let through."""

import re
from types import SimpleNamespace

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import hurwitz, integrators, linalg, metrics, noise, observers, plants, signals

CHAIN = plants.IntegratorChain(2)
NAN = float("nan")


def flow(alphas=(1.5, 1.0), gamma=3.0):
    return observers.HighGain(CHAIN, alphas, gamma)


def integral(alphas=(3.0, 3.0, 1.0), gamma=3.0, q=1):
    return observers.IntegralHighGain(CHAIN, alphas, gamma, q)


def tracker(n=2, q=0, mu=3.0, start=1.0):
    return observers.Tracker(n, q, mu, start)


def digital(n=2, q=0, mu=3.0, dt=0.1, start=None):
    return observers.DiscreteTracker(n, q, mu, dt, start)


def sampled(dt):
    return observers.Sampled(flow(), integrators.RK4(), dt)


def learned(weights=((1.0, 1.0),), biases=(0.0,), spread=(1.0, 1.0), dt=0.1):
    return plants.LearnedField(weights, biases, [1.0], [0.0, 0.0], spread, dt)


def tones(decays=(0.1,), dt=0.1):
    return plants.WithTones(plants.SampledChain(2, 0.1), [2.0], decays, dt)


STEPS = plants.SampledChain(2, 0.1)
ESTIMATE = SimpleNamespace(
    ts=jnp.arange(3.0), xhat=jnp.zeros((3, 2)), innovation=jnp.zeros((3, 1)), valid=jnp.ones((3, 1), bool)
)


def compared(x=None, metric=None):
    return metrics.evaluate(metric or metrics.Peak(), ESTIMATE, x)


# the call, Class.field, what was given, what was expected
TABLE = [
    (lambda: flow(alphas=(1, 2, 3)), "HighGain.alphas", "shape (3,)", "shape (2,)"),
    (lambda: flow(alphas=(1, NAN)), "HighGain.alphas", "nan", "finite"),
    (lambda: flow(alphas=(1, -2)), "HighGain.alphas", "[1.0, -2.0] with the root(s) 1", "left half plane"),
    (lambda: flow(alphas=(0, 4)), "HighGain.alphas", "with the root(s) -0+2j, 0-2j", "left half plane"),
    (lambda: flow(gamma=0.0), "HighGain.gamma", "0.0", "a positive number"),
    (lambda: flow(gamma=-1), "HighGain.gamma", "-1.0", "a positive number"),
    (lambda: flow(gamma=np.inf), "HighGain.gamma", "inf", "finite"),
    (lambda: flow(gamma=[1.0, 2.0]), "HighGain.gamma", "shape (2,)", "shape ()"),
    (lambda: integral(alphas=(1.5, 1)), "IntegralHighGain.alphas", "shape (2,)", "shape (3,)"),
    (lambda: integral(alphas=(1, 1, 2)), "IntegralHighGain.alphas", "root(s)", "left half plane"),
    (lambda: integral(gamma=-1), "IntegralHighGain.gamma", "-1.0", "a positive number"),
    (lambda: integral(q=-1), "IntegralHighGain.q", "-1", "an integer >= 0"),
    (lambda: integral(q=1.0), "IntegralHighGain.q", "1.0", "an integer >= 0"),
    (lambda: integral(q=True), "IntegralHighGain.q", "True", "an integer >= 0"),
    (lambda: observers.Luenberger(CHAIN, [1.0, 2.0]), "Luenberger.gain", "shape (2,)", "shape (2, 1)"),
    (lambda: observers.Luenberger(CHAIN, [[1.0], [NAN]]), "Luenberger.gain", "nan", "finite"),
    (lambda: observers.StepLuenberger(plants.SampledChain(2, 0.1), [[1.0]]), "StepLuenberger.gain", "(1, 1)", "(2, 1)"),
    (lambda: observers.CurrentLuenberger(plants.SampledChain(2, 0.1), [[1.0]]), "CurrentLuenberger.gain", "(1, 1)", "(2, 1)"),
    (lambda: tracker(n=0), "Tracker.n", "0", "an integer >= 1"),
    (lambda: tracker(n=2.0), "Tracker.n", "2.0", "an integer >= 1"),
    (lambda: tracker(q=-1), "Tracker.q", "-1", "an integer >= 0"),
    (lambda: tracker(mu=0.0), "Tracker.mu", "0.0", "a positive number"),
    (lambda: tracker(mu=NAN), "Tracker.mu", "nan", "finite"),
    (lambda: tracker(mu=[1.0]), "Tracker.mu", "shape (1,)", "shape ()"),
    (lambda: tracker(start=0.0), "Tracker.start", "0.0", "a positive number"),
    (lambda: tracker(n=8, q=3), "Tracker.n", "n + q = 11", "n + q <= 10"),
    (lambda: digital(n=0), "DiscreteTracker.n", "0", "an integer >= 1"),
    (lambda: digital(mu=-2.0), "DiscreteTracker.mu", "-2.0", "a positive number"),
    (lambda: digital(dt=0.0), "DiscreteTracker.dt", "0.0", "a positive number"),
    (lambda: digital(dt=[0.1, 0.2]), "DiscreteTracker.dt", "shape (2,)", "shape ()"),
    (lambda: digital(start=-1.0), "DiscreteTracker.start", "-1.0", "a positive number"),
    (lambda: sampled(-0.1), "Sampled.dt", "-0.1", "a positive number"),
    (lambda: sampled([0.1]), "Sampled.dt", "shape (1,)", "shape ()"),
    (lambda: plants.IntegratorChain(0), "IntegratorChain.n", "0", "an integer >= 1"),
    (lambda: plants.IntegratorChain(2.0), "IntegratorChain.n", "2.0", "an integer >= 1"),
    (lambda: plants.SampledChain(2, 0.0), "SampledChain.dt", "0.0", "a positive number"),
    (lambda: plants.SineChain(1.0, 0), "SineChain.n", "0", "an integer >= 1"),
    (lambda: plants.Discretised(plants.Lorenz(), integrators.Euler(), -0.1), "Discretised.dt", "-0.1", "a positive number"),
    (lambda: plants.Discretised(CHAIN, integrators.Euler(), 0.0), "Discretised.dt", "0.0", "a positive number"),
    (lambda: plants.Pendulum(a=NAN), "Pendulum.a", "nan", "finite"),
    (lambda: plants.Pendulum(b=[1.0, 2.0]), "Pendulum.b", "shape (2,)", "shape ()"),
    (lambda: learned(weights=[[1.0, 1.0], [0.0, 1.0]]), "LearnedField.weights", "shape (2, 2)", "shape (1, 2)"),
    (lambda: learned(biases=[0.0, 1.0]), "LearnedField.biases", "shape (2,)", "shape (1,)"),
    (lambda: learned(spread=[1.0, 0.0]), "LearnedField.spread", "[1. 0.]", "a positive number"),
    (lambda: learned(dt=0.0), "LearnedField.dt", "0.0", "a positive number"),
    (lambda: tones(decays=[0.1, 0.2]), "WithTones.decays", "shape (2,)", "shape (1,)"),
    (lambda: tones(dt=0.0), "WithTones.dt", "0.0", "a positive number"),
    (lambda: signals.Sine(order=-1), "Sine.order", "-1", "an integer >= 0"),
    (lambda: signals.Sine(amplitude=NAN), "Sine.amplitude", "nan", "finite"),
    (lambda: signals.Zero(-1), "Zero.m", "-1", "an integer >= 0"),
    (lambda: signals.Held([0, 1], [1, 2]), "Held.values", "ts (2,) and values (2,)", "(T,) and (T, m)"),
    (lambda: signals.Recorded([0, 1], [[1], [NAN]]), "Recorded.values", "nan", "finite"),
    (lambda: signals.Recorded([0, 1, 1], [[1], [2], [3]]), "Recorded.ts", "ts[2] <= ts[1]", "increasing times"),
    (lambda: noise.Gaussian(-0.1), "Gaussian.sigma", "-0.1", "a number >= 0"),
    (lambda: noise.Gaussian([0.1, 0.2]), "Gaussian.sigma", "shape (2,)", "shape ()"),
    (lambda: noise.Uniform(NAN), "Uniform.width", "nan", "a number >= 0"),
    (lambda: noise.Bias(NAN), "Bias.value", "nan", "finite"),
    (lambda: noise.Sinusoid(1.0, np.inf), "Sinusoid.frequency", "inf", "finite"),
    (lambda: noise.Dropout(1.5), "Dropout.probability", "1.5", "a number in [0, 1]"),
    (lambda: noise.Outliers(-0.1, 1.0), "Outliers.probability", "-0.1", "a number in [0, 1]"),
    (lambda: noise.Sum(()), "Sum.parts", "()", "at least one noise"),
    (lambda: integrators.Euler(0), "Euler.substeps", "0", "an integer >= 1"),
    (lambda: integrators.RK4(1.5), "RK4.substeps", "1.5", "an integer >= 1"),
    (lambda: integrators.Exponential(0), "Exponential.substeps", "0", "an integer >= 1"),
    (lambda: integrators.Adaptive(max_steps=0), "Adaptive.max_steps", "0", "an integer >= 1"),
    (lambda: metrics.SettlingTime(0.0), "SettlingTime.tolerance", "0.0", "a positive number"),
    (lambda: metrics.NoiseGain(0.0), "NoiseGain.sigma", "0.0", "a positive number"),
    (lambda: metrics.Consistency(-1.0), "Consistency.variance", "-1.0", "a positive number"),
    (lambda: metrics.Whiteness(0), "Whiteness.lags", "0", "an integer >= 1"),
    (lambda: metrics.RMSE(after=NAN), "RMSE.after", "nan", "finite"),
    (lambda: flow(gamma=None), "HighGain.gamma", "None", "a number"),
    (lambda: tracker(mu=None), "Tracker.mu", "None", "a number"),
    (lambda: tracker(start=None), "Tracker.start", "None", "a number"),
    (lambda: digital(mu=None), "DiscreteTracker.mu", "None", "a number"),
    (lambda: digital(dt=None), "DiscreteTracker.dt", "None", "a number"),
    (lambda: plants.Pendulum(a=None), "Pendulum.a", "None", "a number"),
    (lambda: flow(gamma="3"), "Parameter", "'3'", "real numbers"),
    (lambda: flow(alphas=[1.0, [2.0, 3.0]]), "Parameter", "[1.0, [2.0, 3.0]]", "real numbers"),
    (lambda: flow(alphas=[1.0, 2j]), "Parameter", "2j", "real numbers"),
    (lambda: observers.HighGain(plants.Lorenz(), [1.5, 1.0], 3.0), "HighGain.model", "Lorenz", "AbstractChain"),
    (lambda: observers.HighGain(plants.Pendulum, [1.5, 1.0], 3.0), "HighGain.model", "the class Pendulum", "AbstractChain"),
    (lambda: observers.Luenberger(STEPS, [[1.0], [1.0]]), "Luenberger.model", "SampledChain", "AbstractFlowPlant"),
    (lambda: observers.StepLuenberger(CHAIN, [[1.0], [1.0]]), "StepLuenberger.model", "Chain", "AbstractStepPlant"),
    (lambda: observers.CurrentLuenberger(CHAIN, [[1.0], [1.0]]), "CurrentLuenberger.model", "Chain", "AbstractStepPlant"),
    (lambda: observers.Sampled(digital(), integrators.RK4(), 0.1), "Sampled.observer", "Tracker", "AbstractFlowObserver"),
    (lambda: observers.Sampled(flow(), integrators.RK4, 0.1), "Sampled.integrator", "the class RK4", "AbstractIntegrator"),
    (lambda: observers.Sampled(flow(), 0.1, 0.1), "Sampled.integrator", "float 0.1", "AbstractIntegrator"),
    (lambda: plants.Discretised(STEPS, integrators.RK4(), 0.1), "Discretised.plant", "SampledChain", "AbstractFlowPlant"),
    (lambda: plants.Discretised(CHAIN, "RK4", 0.1), "Discretised.integrator", "str 'RK4'", "AbstractIntegrator"),
    (lambda: plants.WithTones(CHAIN, [2.0], [0.1], 0.1), "WithTones.plant", "IntegratorChain", "AbstractStepPlant"),
    (lambda: tones(dt=0.2), "WithTones.dt", "0.2", "SampledChain.dt = 0.1"),
    (lambda: noise.Sum(noise.Bias(0.1)), "Sum.parts", "Bias", "tuple"),
    (lambda: noise.Sum((noise.Bias(0.1), noise.Gaussian)), "Sum.parts[1]", "the class Gaussian", "AbstractNoise"),
    (lambda: integrators.Adaptive(rtol=0.0), "Adaptive.rtol", "0.0", "a positive number"),
    (lambda: integrators.Adaptive(atol=-1e-9), "Adaptive.atol", "-1e-09", "a positive number"),
    (lambda: integrators.Adaptive(diffrax.Tsit5), "Adaptive.solver", "the class Tsit5", "AbstractSolver"),
    (lambda: compared(), "evaluate.x", "None", "shape (3, 2)"),
    (lambda: compared(np.zeros((3, 1))), "evaluate.x", "shape (3, 1)", "shape (3, 2)"),
    (lambda: compared(np.zeros((3, 2)), metrics.Peak), "evaluate.metric", "the class Peak", "AbstractMetric"),
    (lambda: metrics.rmse(jnp.zeros((3, 2)), jnp.zeros((3, 1))), "rmse.xhat", "shape (3, 1)", "shape (3, 2)"),
    (lambda: linalg.smallest_gamma(hurwitz.binomial(2), -1.0), "smallest_gamma.lipschitz", "-1.0", "a number >= 0"),
    (lambda: hurwitz.alphas_from_q([1.0, -2.0]), "alphas_from_q.q_2", "-2.0", "a positive number"),
]


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("make", "where", "given", "expected"), TABLE, ids=[f"{where} {given}" for _, where, given, _ in TABLE]
)
def test_refused(make, where, given, expected):
    with pytest.raises(ValueError, match=re.escape(f"{where}: given ")) as refusal:
        make()
    told, _, wanted = str(refusal.value).partition("; expected ")
    assert given in told
    assert expected in wanted
    assert wanted.endswith(".")  # and then what to try
    assert ". " in wanted


@pytest.mark.usefixtures("as_users_have_it")
def test_two_precisions_in_one_object_are_refused():
    with pytest.raises(ValueError, match="HighGain: given parameters of float32 and float64; expected one precision"):
        flow(gamma=jnp.float32(3.0))


VALUES = [
    (lambda v: flow(gamma=v), -1.0),
    (lambda v: flow(alphas=v), [1.0, -2.0]),
    (lambda v: tracker(mu=v), 0.0),
    (lambda v: digital(dt=v), -0.1),
    (lambda v: noise.Gaussian(v), -0.1),
    (lambda v: noise.Dropout(v), 1.5),
    (lambda v: metrics.Consistency(v), NAN),
]


@pytest.mark.parametrize(("make", "bad"), VALUES)
def test_traced_values_are_let_through(make, bad):
    bad = jnp.asarray(bad)
    with pytest.raises(ValueError, match="given"):
        make(bad)
    made = jax.jit(make)(bad)
    assert any(np.array_equal(leaf, bad, equal_nan=True) for leaf in jax.tree.leaves(made))
    jax.vmap(make)(jnp.stack([bad, bad]))


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(("make", "shape"), [(lambda v: flow(alphas=v), 3), (lambda v: flow(gamma=v), 1), (noise.Bias, 2)])
def test_traced_shapes_are_not(make, shape):
    with pytest.raises(ValueError, match="given shape"):
        jax.eval_shape(make, jnp.ones(shape))
