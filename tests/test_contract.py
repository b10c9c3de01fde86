"""One contract for every public class of plants, signals, noise, integrators, observers and metrics."""

import inspect
import pickle
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import CASES, PACKAGES, build, inputs, work

import jaxobs
from jaxobs import noise, observers, plants, signals
from jaxobs._module import Module, float_leaves

EPS = float(np.finfo(np.float64).eps)


class Subject:
    """An object with its inputs, and one compiled `work` that all its tests share."""

    def __init__(self, label: str):
        self.label, self.thing, self.traces = label, build(label), 0
        self.given = inputs(self.thing)
        self.numbers, self.rest = eqx.partition((self.thing, self.given), eqx.is_inexact_array)
        self.run = jax.jit(self.traced)

    def traced(self, numbers: Any) -> Any:
        self.traces += 1
        return self.plain(numbers)

    def plain(self, numbers: Any) -> Any:
        return work(*eqx.combine(numbers, self.rest))

    def weighted(self, outputs: Any) -> Any:
        """One number that depends on every output."""
        flat = [leaf.reshape(-1) for leaf in float_leaves(outputs)]
        return sum(jnp.sum(jnp.cos(jnp.arange(leaf.size, dtype=leaf.dtype)) * leaf) for leaf in flat)

    def replaced(self, i: int, leaf: Any) -> Any:
        leaves, structure = jax.tree.flatten(self.numbers)
        return jax.tree.unflatten(structure, [*leaves[:i], leaf, *leaves[i + 1 :]])


# Further ways to build a class that has a case already: in the long run.
LABELS = [pytest.param(label, marks=pytest.mark.slow) if " " in label else label for label in CASES]


@pytest.fixture(scope="module", params=LABELS)
def subject(request):
    return Subject(request.param)


def public_classes() -> set[type]:
    members = [(package, cls) for package in PACKAGES for cls in vars(package).values() if inspect.isclass(cls)]
    mine = [cls for package, cls in members if issubclass(cls, Module) and cls.__module__.startswith(package.__name__)]
    return {cls for cls in mine if not cls.__name__.startswith(("_", "Abstract"))}


def close(actual: Any, desired: Any, ulps: int = 64) -> None:
    """Equal up to the rounding of sums in another order, leaf by leaf."""
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(desired), strict=True):
        b = np.asarray(b)
        np.testing.assert_allclose(a, b, rtol=ulps * EPS, atol=ulps * EPS * np.max(np.abs(b), initial=0))


def test_every_public_class_has_a_case():
    covered = {type(build(label)) for label in CASES}
    missing = sorted(f"{cls.__module__}.{cls.__name__}" for cls in public_classes() - covered)
    assert not missing, f"no line in tests/cases.py for {', '.join(missing)}"
    assert all(label.split()[0] == type(build(label)).__name__ for label in CASES)


def test_shapes_are_the_declared_ones(subject):
    thing, out = subject.thing, jax.eval_shape(subject.plain, subject.numbers)
    if isinstance(thing, plants.AbstractPlant):
        assert out["flow" if "flow" in out else "step"].shape == (thing.n,)
        assert out["h"].shape == (thing.p,)
        assert out["disturbance"].shape[0] == thing.n
    elif isinstance(thing, observers.AbstractObserver):
        assert out["xhat"].shape == (3, thing.n)
        assert out["predict"].shape == (3, thing.p)
    elif isinstance(thing, signals.AbstractSignal):
        assert out["u"].shape[:2] == (4, thing.m)
    elif isinstance(thing, noise.AbstractNoise):
        assert out["w"].shape == out["valid"].shape == (6, 2)


def test_leaves_are_strong_arrays_of_one_precision(subject):
    leaves = float_leaves(subject.thing)
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == np.float64 and not leaf.weak_type for leaf in leaves)
    assert not [leaf for leaf in jax.tree.leaves(subject.thing) if isinstance(leaf, float | np.ndarray)]


def test_jit_equals_eager(subject):
    close(subject.run(subject.numbers), subject.plain(subject.numbers))


def test_second_call_does_not_retrace(subject):
    subject.run(subject.numbers)
    other = jax.tree.map(lambda leaf: leaf * 1.01, subject.numbers)
    subject.run(other)
    assert subject.traces == 1


def test_vmap_over_a_leaf_equals_the_loop(subject):
    i = max(len(float_leaves(subject.thing)) - 1, 0)  # its last number (a gain, a period), or the first input if it has none
    batch = jnp.stack([jax.tree.leaves(subject.numbers)[i] * scale for scale in (1, 1.02, 0.97)])
    together = jax.jit(jax.vmap(lambda leaf: subject.plain(subject.replaced(i, leaf))))(batch)
    alone = [subject.run(subject.replaced(i, leaf)) for leaf in batch]
    close(together, jax.tree.map(lambda *lanes: np.stack(lanes), *alone))


def test_gradient_equals_finite_differences(subject):
    def value(numbers):
        return float(subject.weighted(subject.run(numbers)))

    gradients = jax.tree.leaves(jax.jit(jax.grad(lambda numbers: subject.weighted(subject.plain(numbers))))(subject.numbers))
    for i, leaf in enumerate(map(np.asarray, jax.tree.leaves(subject.numbers))):
        expected = np.zeros(leaf.shape)
        for at in np.ndindex(leaf.shape):
            step = np.zeros(leaf.shape)
            step[at] = EPS ** (1 / 3) * max(1, abs(leaf[at]))
            up, down = (value(subject.replaced(i, jnp.asarray(leaf + sign * step))) for sign in (1, -1))
            expected[at] = (up - down) / (2 * step[at])
        # A central difference is good to eps^(2/3) of the function's own scale.
        scale = max(1, np.max(np.abs(expected), initial=0), abs(value(subject.numbers)))
        np.testing.assert_allclose(gradients[i], expected, rtol=0, atol=1e3 * EPS ** (2 / 3) * scale)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_precision_in_is_precision_out(subject, dtype):
    thing = build(subject.label, dtype)
    out = jax.eval_shape(work, thing, inputs(thing, dtype))
    if not float_leaves(thing):
        out.pop("disturbance", None)  # without a number of its own a plant knows no precision: whoever uses E converts it
    floats = [leaf for leaf in jax.tree.leaves(out) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    assert all(leaf.dtype == dtype and not leaf.weak_type for leaf in floats)


def test_astype_is_construction_in_that_precision(subject):
    converted, built = jaxobs.astype(subject.thing, jnp.float32), build(subject.label, np.float32)
    assert jax.tree.structure(converted) == jax.tree.structure(built)
    assert all(a.dtype == b.dtype and (a == b).all() for a, b in zip(*map(float_leaves, (converted, built)), strict=True))


def test_pickle_round_trip(subject):
    again = pickle.loads(pickle.dumps(subject.thing))
    assert jax.tree.structure(again) == jax.tree.structure(subject.thing)
    assert eqx.tree_equal(again, subject.thing)


def test_prints_short(subject):
    text = repr(subject.thing)
    assert text.startswith(type(subject.thing).__name__)
    assert len(text) < 500


@pytest.mark.parametrize("label", [c for c in CASES if hasattr(build(c), "split")])
def test_split_is_the_flow_with_a_constant_matrix(label):
    thing = build(label)
    given = inputs(thing)
    first = work(thing, given)
    a, b = first["split"]
    z = given["x"] if "x" in given else thing.init(given["xhat0"])
    close(a @ z + b, first["flow"])
    elsewhere = {name: value if name == "t" else value * -1.7 + 0.4 for name, value in given.items()}
    assert (work(thing, elsewhere)["split"][0] == a).all()


@pytest.mark.parametrize("label", [c for c in CASES if isinstance(build(c), observers.AbstractObserver)])
def test_the_expected_output_leaves_the_guess_as_it_is(label):
    """y = predict makes the innovation zero: at the start the estimate is then xhat0 itself."""
    observer = build(label)
    given = inputs(observer)
    time = given["t"] if isinstance(observer, observers.AbstractFlowObserver) else jnp.asarray(0)
    z, u = observer.init(given["xhat0"]), given["u"][0]
    close(observer.estimate(time, z, u, observer.predict(time, z, u)), given["xhat0"])
