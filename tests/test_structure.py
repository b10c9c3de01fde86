"""Forms from the pattern of the Jacobian, Lie derivatives against sympy, observability proved, refuted and sampled."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sympy
from cases import CASES, build

from jaxobs import designs, observers, plants, structure
from jaxobs.intervals import Interval
from jaxobs.plants import FlowFunction, from_function, from_step_function
from jaxobs.structure import text
from jaxobs.structure.algebra import adjugate, determinant, enclosed_inverse, sign_on, vanishes

pytestmark = pytest.mark.usefixtures("hardly_optimised")
FORMS = {
    "chain": plants.AbstractChain,
    "triangular": plants.AbstractTriangular,
    "blocks": plants.AbstractBlockTriangular,
    "state_affine": plants.AbstractStateAffine,
    "lipschitz": plants.AbstractLipschitz,
}
T0 = np.zeros(())
FLOWS = [label for label in CASES if isinstance(build(label), plants.AbstractFlowPlant) and "Normal" not in label]
STEPS = [label for label in CASES if isinstance(build(label), plants.AbstractStepPlant)]


def shuffled(x, u):
    """A chain in the order x3, x1, x2."""
    return [x[1], jnp.sin(x[2]) * u[0] - x[1], x[0]]


def third(x, u):
    return x[2]


def first(x, u):
    return x[0]


def coupled(x, u):
    """Triangular in the order x1, x3, x2, the second coupling with the input."""
    return [2.0 * x[2] + x[0] ** 2, x[0] * x[1] * x[2], (2 + jnp.cos(u[0])) * x[1] - x[2]]


def switched(x, u):
    return [x[1], jnp.where(x[1] > 0, -1.0, 1.0)]


def looped(x, u):
    """A while loop: neither formulas nor intervals follow it."""
    return [x[1], jax.lax.while_loop(lambda s: s[0] < 3.0, lambda s: (s[0] + 1.0, s[1] / 2), (x[0], x[1]))[1]]


class SortedInTime(FlowFunction):
    def flow(self, t, x, u):
        return super().flow(t, x, u) + jnp.sin(t)


def sorted_up(x, u):
    """jnp.sort has no exact formula."""
    return [x[1], jnp.sort(x)[0]]


def reactor(x, u):
    """Biomass and substrate with Contois growth (Gauthier, Hammouri and Othman 1992), the biomass measured."""
    growth = x[0] * x[1] / (x[0] + x[1])
    return [growth - u[0] * x[0], -growth + u[0] * (0.1 - x[1])]


def blind(x, u):
    """u = 1 hides x2."""
    return [(1 - u[0]) * x[1], -x[1]]


@pytest.mark.parametrize("label", FLOWS)
def test_every_plant_is_seen_as_what_it_is_written_as(label):
    plant = build(label)
    found = structure.forms(plant)
    for name, kind in FORMS.items():
        if isinstance(plant, kind):
            assert getattr(found, name) is plant
            assert name in found.parts
    assert found.source == "exact formulas"
    said = " ".join(str(found).split())
    for name, why in found.why.items():
        assert name not in found.parts
        assert why in said or text._moot(name, list(found.parts), found)


@pytest.mark.parametrize("label", STEPS)
def test_step_plants_are_linear_or_nothing(label):
    linear = structure.forms(build(label)).linear
    assert (linear is not None) == (label in ("SampledChain", "WithTones", "LinearStep"))


@pytest.mark.parametrize("label", ["Lorenz", "Hovercraft", "FieldMotor", "FlexibleJoint", "Rossler"])
def test_the_pattern_is_that_of_samples(label):
    """Sampled Jacobians: zero exactly where the pattern says so, constant where it says so."""
    plant = build(label)
    found, rng = structure.forms(plant), np.random.default_rng(0)
    slopes = jax.vmap(lambda x, u: jax.jacfwd(lambda x: plant.flow(T0, x, u))(x))
    values = np.asarray(jax.jit(slopes)(rng.normal(size=(16, plant.n)), rng.normal(size=(16, plant.m))))
    np.testing.assert_array_equal(np.all(values == 0, axis=0), found.flow == "0")
    np.testing.assert_array_equal(np.ptp(values, axis=0) < 1e-12, np.isin(found.flow, ["0", "1", "c"]))


def test_a_chain_is_found_in_any_order_and_takes_the_designs_of_chains():
    plant = from_function(shuffled, third, n=3, m=1)
    chain = structure.forms(plant).chain
    assert chain.order == (2, 0, 1)
    x, u = jnp.asarray([0.3, -0.4, 0.8]), jnp.asarray([0.5])
    np.testing.assert_allclose(chain.flow(T0, chain.to_normal(x), u), chain.to_normal(plant.flow(T0, x, u)), rtol=1e-15)
    np.testing.assert_array_equal(chain.to_original(chain.to_normal(x)), x)
    observer, certificate = designs.riccati(chain, lipschitz=1.5)
    assert certificate.verify()
    assert isinstance(observer, observers.HighGain)


def test_triangular_with_couplings_of_the_input():
    found = structure.forms(from_function(coupled, first, n=3, m=1))
    form = found.triangular
    assert form.order == (0, 2, 1)
    np.testing.assert_allclose(form.a(jnp.asarray([0.5])), [2.0, 2 + np.cos(0.5)], rtol=1e-15)
    slope = jax.jacfwd(lambda z: form.g(z, jnp.asarray([0.5])))(jnp.asarray([0.3, 0.2, -0.7]))
    np.testing.assert_array_equal(np.triu(slope, 1), 0)
    z, u = jnp.asarray([0.3, 0.2, -0.7]), jnp.asarray([0.5])
    np.testing.assert_allclose(form.flow(T0, z, u), form.moved(z, u), rtol=1e-14)
    assert found.chain is None
    assert "x1' is not one of the states" in str(found)


@pytest.mark.parametrize("label", ["Pendulum", "Lienard", "Duffing", "FlexibleJoint", "IntegratorChain"])
def test_every_form_of_a_plant_has_its_flow_and_output(label):
    plant = build(label)
    x, u = jnp.linspace(0.4, -0.9, plant.n), jnp.linspace(0.2, 0.3, plant.m)
    for name in structure.forms(plant).parts:
        form = getattr(structure.forms(plant), name)
        np.testing.assert_allclose(eqx.filter_jit(form.flow)(T0, x, u), plant.flow(T0, x, u), rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(form.h(x, u), plant.h(x, u), rtol=1e-15)


@pytest.mark.slow
def test_bounds_on_a_box_are_the_lipschitz_constant():
    found = structure.forms(build("Pendulum"), states=([-4.0, -1.0], [4.0, 1.0]), inputs=([-0.5], [0.5]))
    exact = np.sqrt(1.2**2 + 0.5**2 + 0.3**2)  # max of (a cos x1 - u sin x1)^2 + b^2
    assert exact <= found.slopes.constant <= exact * (1 + 1e-5)
    assert f"{found.slopes.constant:.6g}" in str(found)
    free = structure.forms(build("VanDerPol"), states=([-np.inf] * 2, [np.inf] * 2))
    assert np.isinf(free.slopes.constant)
    assert "nothing bounds phi" in str(free)


def test_what_cannot_be_followed_is_said():
    unknown = structure.forms(from_function(looped, first, n=2))
    assert unknown.source == "nothing"
    assert unknown.chain is None
    assert "while" in str(unknown)
    jumping = structure.forms(from_function(switched, first, n=2))
    assert jumping.chain is not None
    assert jumping.linear is None
    assert "switches at x2 = 0" in str(jumping) or "switches at -x2 = 0" in str(jumping)
    with pytest.raises(ValueError, match=r"as_chain.plant: given Lorenz, where x2' is not one of the states"):
        structure.as_chain(build("Lorenz"))
    with pytest.raises(ValueError, match=r"forms.states: given shapes \(1,\)"):
        structure.forms(build("Pendulum"), states=([0.0], [1.0]))


@pytest.mark.usefixtures("as_users_have_it")
def test_no_plant_is_refused():
    with pytest.raises(ValueError, match=r"forms.plant: given int 3; expected"):
        structure.forms(3)


def test_intervals_take_over_where_there_is_no_formula():
    found = structure.forms(from_function(sorted_up, first, n=2))
    assert "interval arithmetic" in found.source
    assert found.flow.tolist() == [
        ["*", "*"],
        ["*", "*"],
    ]  # a sorted list switches: nothing is claimed of what stands beside it
    assert found.linear is None
    assert found.parts == {"lipschitz": ((0, 1), (0,), ())}  # B = I: all of f may be nonlinear
    assert found.jumps
    assert "Other coordinates may help" in str(found)
    assert not any("depends on t:" in why for why in found.why.values())
    moved = structure.forms(SortedInTime(sorted_up, first, n=2))
    assert "Other coordinates" not in str(moved)
    assert all("depends on t:" in moved.why[name] for name in ("chain", "triangular", "lipschitz"))


def test_designs_and_observers_that_are_named_exist():
    for named, seen in text.DESIGNS.values():
        for name in named.replace(" with ", ", ").split(", "):
            if not name.startswith("for inputs"):
                assert hasattr(designs, name)
        assert all(hasattr(observers, name) for name in seen.split(", "))


@pytest.mark.parametrize("label", ["VanDerPolSeen", "Rossler", "FlowFunction"])
def test_lie_derivatives_equal_those_of_sympy(label):
    plant = build(label)
    n, u = plant.n, jnp.asarray([0.4] * plant.m)
    xs = sympy.symbols(f"x1:{n + 1}")
    if label == "VanDerPolSeen":
        f, hs = [xs[1], sympy.Float(1.3) * (1 - xs[0] ** 2) * xs[1] - xs[0]], [xs[1]]
    elif label == "Rossler":
        f = [-xs[1] - xs[2], xs[0] + sympy.Float(0.3) * xs[1], sympy.Float(0.2) + xs[2] * (xs[0] - 5)]
        hs = [xs[1], sympy.Float(0.5) * xs[0] + xs[2]]
    else:
        f, hs = [xs[1] + sympy.Float(0.3) * xs[0] ** 3, -sympy.sin(xs[0]) + sympy.Float(0.4) * xs[1]], [xs[0]]
    x = np.linspace(0.5, -0.8, n)
    found = np.asarray(plants.lie_derivatives(plant, jnp.asarray(x), u, 4))
    slopes = np.asarray(jax.jit(jax.jacfwd(lambda x: plants.lie_derivatives(plant, x, u, 2)))(jnp.asarray(x)))
    at = dict(zip(xs, x, strict=True))
    for i, h in enumerate(hs):
        for k in range(5):
            np.testing.assert_allclose(found[k, i], float(h.subs(at)), rtol=1e-12, atol=1e-12)
            if k <= 2:
                np.testing.assert_allclose(slopes[k, i], [float(sympy.diff(h, v).subs(at)) for v in xs], rtol=1e-12, atol=1e-12)
            h = sum(sympy.diff(h, v) * fv for v, fv in zip(xs, f, strict=True))


def test_lie_derivatives_are_the_derivatives_of_the_output():
    """A chain of 8: y^(k) = x_{k+1}; and one Lie derivative by itself."""
    plant, x = plants.IntegratorChain(8), jnp.arange(8.0)
    np.testing.assert_array_equal(plants.observability_map(plant, x, jnp.zeros(plant.m)), x)
    once = plants.lie_derivative(lambda x: x[0] ** 2, lambda x: jnp.stack([x[1], -x[0]]))
    assert float(once(jnp.asarray([2.0, 3.0]))) == 12.0
    with pytest.raises(ValueError, match=r"observability_map.indices: given None; expected 2 integers"):
        plants.observability_map(build("Hovercraft"), jnp.ones(5), jnp.ones(2))


def test_observability_is_proved_refuted_or_sampled():
    proved = structure.observability(build("Duffing"), states=([-0.4, -0.4], [0.4, 0.4]), count=32)
    assert (proved.regular, proved.rank, len(proved.lost)) == ("proved", 2, 0)  # det = -a - 3 b x1^2 - 1 ... < 0 there
    refuted = structure.observability(plants.VanDerPolSeen(1.0, [[0.0, 1.0]]), states=([-1.0, -1.0], [1.0, 1.0]), count=32)
    assert refuted.regular == "refuted"
    assert not refuted
    signs = [1 + 2 * a * b for a, b in refuted.between]  # y = x2: det dPhi/dx = 1 + 2 x1 x2
    assert signs[0] * signs[1] < 0
    sampled = structure.observability(build("Duffing"), states=([-0.4, -0.4], [0.4, 0.4]), count=32, max_boxes=0)
    assert (sampled.regular, bool(sampled)) == ("sampled", True)
    assert "not proved" in str(sampled)
    assert "Proved on the box" in str(proved)


def test_the_condition_number_is_that_of_the_scaled_jacobian():
    plant = plants.Linear([[0.0, 2.0], [0.0, 0.0]], None, [[1.0, 0.0]])
    found = structure.observability(plant, states=([-1, -5], [1, 5]), count=8)
    np.testing.assert_allclose([found.median, found.worst], 1.0, rtol=1e-12)  # each row has one entry, scaled to 1


@pytest.mark.slow
def test_rank_is_lost_where_it_is():
    """x1' = x1 x2, y = x1: nothing is told of x2 at x1 = 0."""
    found = structure.observability(from_function(product, first, n=2), states=([0, -1], [1, 1]), count=16, max_boxes=16)
    assert len(found.lost) == 2  # the two corners on x1 = 0
    assert np.all(found.lost[:, 0] == 0)
    assert found.rank == 1
    assert found.regular != "proved"
    with pytest.raises(ValueError, match=r"normal_form.states: given a box where Phi loses rank"):
        structure.normal_form(from_function(product, first, n=2), states=([0.0, -1.0], [1.0, 1.0]), count=16)


def product(x, u):
    return [x[0] * x[1], -x[1]]


@pytest.mark.slow
def test_indices_of_several_outputs_make_full_rank():
    box = ([-1.0] * 5, [1.0] * 5), ([0.5, -1.0], [1.0, 1.0])
    found = structure.observability(build("Hovercraft"), states=box[0], inputs=box[1], count=16, max_boxes=0)
    assert sum(found.indices) == 5
    assert found.rank == 5


def test_uniform_observability_is_proved_by_formulas():
    region = {"states": ([0.02, 0.02], [0.08, 0.08]), "inputs": ([0.0], [0.1]), "count": 16}
    found = structure.observability(from_function(reactor, first, n=2, m=1), **region)
    assert (found.regular, found.chain, found.triangular) == ("proved", "no", "proved")
    square = {"states": ([-1, -1], [1, 1]), "inputs": ([-1.0], [2.0]), "count": 16, "max_boxes": 0}
    assert structure.observability(build("Pendulum"), **square).chain == "proved"
    hidden = structure.observability(from_function(blind, first, n=2, m=1), **square)
    assert hidden.triangular == "no"
    assert "hide" in str(hidden)


def test_determinants_inverses_and_signs():
    rng = np.random.default_rng(0)
    m = rng.normal(size=(4, 4))
    np.testing.assert_allclose(determinant(jnp.asarray(m)), np.linalg.det(m), rtol=1e-12)
    np.testing.assert_allclose(adjugate(jnp.asarray(m)), np.linalg.det(m) * np.linalg.inv(m), rtol=1e-10)
    near = enclosed_inverse(Interval(m - 1e-6, m + 1e-6))
    for _ in range(20):
        one = np.linalg.inv(m + 1e-6 * rng.uniform(-1, 1, m.shape))
        assert np.all((near.lower <= one) & (one <= near.upper))
    box, seeds = Interval(np.asarray([-1.0, -1.0]), np.asarray([1.0, 1.0])), rng.uniform(-1, 1, (8, 2))
    assert sign_on(lambda z: 2.5 + z[0] * z[1] - z[0] ** 2, box, seeds, 2000).value == 1
    assert sign_on(lambda z: -2.5 + z[0] * z[1] - z[0] ** 2, box, seeds, 2000).value == -1
    assert sign_on(lambda z: z[0] + 0.1, box, seeds, 2000).value == 0
    assert sign_on(lambda z: z[0] ** 2, box, seeds, 200).value is None  # a zero that bisection cannot exclude
    needle = sign_on(lambda z: (z[0] - 0.3) ** 2 + (z[1] - 0.3) ** 2 - 1e-4, box, np.asarray([[1.0, 1.0]]), 4000)
    assert needle.value in (0, None)


def test_identities_are_proved_and_others_are_not():
    assert vanishes(lambda x, u: (jnp.sin(x[0]) / (x[0] + u[0]) * (x[0] + u[0]) - jnp.sin(x[0]))[None], 1, 1)
    assert vanishes(lambda x, u: ((x[0] + u[0]) ** 3 - x[0] ** 3 - u[0] ** 3 - 3 * x[0] * u[0] * (x[0] + u[0]))[None], 1, 1)
    assert not vanishes(lambda x, u: (jnp.sin(x[0]) - x[0])[None], 1, 0)
    assert not vanishes(lambda x, u: (jnp.sin(x[0]) ** 2 + jnp.cos(x[0]) ** 2 - 1)[None], 1, 0)  # not seen, not claimed


def test_a_step_plant_has_a_pattern_and_says_so():
    found = structure.forms(from_step_function(product, first, n=2))
    assert found.linear is None
    assert "x+ = f(x, u)" in str(found)
    assert found.flow.tolist() == [["*", "*"], ["0", "c"]]
