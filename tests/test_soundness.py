"""Plants made to deceive: what is called proved of them has to be true."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import designs, plants, structure
from jaxobs.intervals import Interval, jacobian_bounds, require_derivatives
from jaxobs.intervals.negative import is_negative
from jaxobs.plants import NormalChain, from_function

BOX = ([-2.0, -2.0], [2.0, 2.0])


def swing(x, u):
    return [x[1], -jnp.sin(x[0])]


def pushed(x, u):
    return [x[1], -jnp.sin(x[0]) + u[0]]


def first(x, u):
    return x[0]


def switching(x, u):
    return x[0] + 3 * jnp.sign(x[1])


def quantised(x, u):
    return jnp.round(100 * x[0]) / 100


def driven_output(x, u):
    return x[0] + u[0]


@jax.custom_jvp
def steep(x):
    return jnp.sin(10 * x)


steep.defjvp(lambda primals, tangents: (steep(*primals), 0.1 * tangents[0]))


def declared(x, u):
    return [x[1], -steep(x[0])]


def stopped(x, u):
    return [x[1], -x[0] + jax.lax.stop_gradient(50 * x[0])]


def stopped_output(x, u):
    return x[0] + jax.lax.stop_gradient(5 * x[1])


def pole(x, u):
    return [1 / x[1] ** 2, -x[1]]


def log_pole(x, u):
    return [jnp.log(x[1] ** 2), -x[1]]


def partly(x, u):
    return [x[1] + jnp.sqrt(x[0]), -x[1]]


def jumping(x, u):
    return [x[1] - 4 * jnp.sign(x[1]), -x[1]]


class Timed(plants.AbstractFlowPlant):
    """x1' = x2, x2' = -x1 - 50 t x1."""

    n = 2
    m = 0
    p = 1

    def flow(self, t, x, u):
        return jnp.stack([x[1], -x[0] - 50 * t * x[0]])

    def h(self, x, u):
        return x[:1]

    def disturbance_matrix(self):
        return jnp.eye(2)


@pytest.mark.parametrize("h", [switching, quantised])
def test_an_output_that_jumps_has_no_slope(h):
    """Neither a certificate nor a proof that there is none: C would be a lie."""
    with pytest.raises(ValueError, match=r"lpv_from\.C: given an output that is not smooth"):
        designs.survey(from_function(swing, h, n=2), BOX, rate=1.0)


@pytest.mark.parametrize(("f", "h"), [(declared, first), (stopped, first), (swing, stopped_output)])
def test_declared_derivatives_prove_nothing(f, h):
    plant, where = from_function(f, h, n=2), "f" if h is first else "h"
    with pytest.raises(ValueError, match=rf"lpv_from\.{where}: given a function with (custom_jvp|stop_gradient)"):
        designs.survey(plant, BOX, rate=1.0)
    with pytest.raises(ValueError, match=rf"observability\.{where}: given a function with (custom_jvp|stop_gradient)"):
        structure.observability(plant, states=BOX)
    if h is first:
        with pytest.raises(ValueError, match=r"jacobian_bounds\.f: given a function with (custom_jvp|stop_gradient)"):
            structure.forms(plant, states=BOX)
        with pytest.raises(ValueError, match=r"normal_slopes\.f: given a function with (custom_jvp|stop_gradient)"):
            structure.normal_slopes(NormalChain(plant, jnp.zeros(2)), states=BOX)


def test_the_rules_of_jax_itself_are_no_obstacle():
    require_derivatives("f", lambda x: jnp.stack([jnp.logaddexp(x[0], x[1]), jax.nn.softplus(x[1]), jax.nn.silu(x[0])]), 2)
    found = jacobian_bounds(lambda x: jax.nn.relu(x), BOX, max_boxes=50)
    np.testing.assert_allclose([found.lower[0, 0], found.upper[0, 0]], [0, 1])
    with pytest.raises(ValueError, match=r"f\.f: given a function with custom_jvp_call \(test_soundness\.py\)"):
        require_derivatives("f", jax.jit(lambda x: jax.vmap(steep)(x)), 2)


def test_a_form_has_no_input_in_its_output():
    plant = from_function(pushed, driven_output, n=2, m=1)
    found = structure.observability(plant, states=BOX, inputs=([-1.0], [1.0]), count=16)
    assert (found.chain, found.triangular) == ("no", "no")
    with pytest.raises(ValueError, match=r"normal_form\.plant"):
        structure.normal_form(plant, states=BOX, inputs=([-1.0], [1.0]), count=16)
    with pytest.raises(ValueError, match=r"NormalChain\.plant: given y = h\(x, u\), which knows the input"):
        NormalChain(plant, jnp.zeros(2))
    assert structure.observability(from_function(pushed, first, n=2, m=1), states=BOX, count=16).chain == "proved"


def test_what_changes_with_time_is_not_frozen():
    with pytest.raises(ValueError, match=r"observability\.plant: given equations that change with time"):
        structure.observability(Timed(), states=BOX)
    with pytest.raises(ValueError, match=r"NormalChain\.plant: given equations that change with time"):
        NormalChain(Timed(), jnp.zeros(2))


@pytest.mark.parametrize("f", [pole, log_pole])
def test_two_signs_across_a_pole_are_no_zero(f):
    found = structure.observability(from_function(f, first, n=2), states=([-1.0, -1.0], [1.0, 1.0]), count=16)
    assert found.regular != "refuted"
    assert "vanishes" not in str(found)


@pytest.mark.parametrize("f", [partly, jumping])
def test_nothing_is_proved_where_the_map_is_undefined_or_jumps(f):
    found = structure.observability(from_function(f, first, n=2), states=([-1.0, -1.0], [1.0, 1.0]), count=64)
    assert found.regular == "sampled"
    assert "Proved on the box" not in str(found)
    assert bool(found) == (len(found.lost) == 0)


def test_a_real_zero_is_still_refuted():
    found = structure.observability(from_function(squared, first, n=2), states=([-1.0, -1.0], [1.0, 1.0]), count=16)
    assert found.regular == "refuted"


def squared(x, u):
    return [x[1] ** 2, -x[1]]


def bent(x, u):
    return [x[1], -jnp.abs(x[0]) - jnp.maximum(x[1], 0.3 * x[1])]


def test_what_is_not_known_to_be_attained_is_said_so():
    found = designs.lpv_from(from_function(bent, first, n=2), None, BOX, max_boxes=200)
    assert "nan" not in found.origin


def half_sine(x):
    return 0.5 * jnp.sin(x)


def of_jax(declare):
    """A function of JAX under a rule of one's own."""
    f = jax.custom_jvp(jax.nn.relu)
    declare(f)
    return f


HIDDEN = {
    "rule": of_jax(lambda f: f.defjvp(lambda primals, tangents: (f(*primals), 0.1 * tangents[0]))),
    "parts": of_jax(lambda f: f.defjvps(lambda t, value, x: 0.1 * t)),
    "equinox": eqx.filter_custom_jvp(half_sine),
    "mapped": jax.vmap(jax.lax.stop_gradient),
    "scanned": lambda x: jax.lax.scan(lambda carry, _: (steep(carry), None), x, length=2)[0],
    "slope": jax.grad(lambda x: jnp.sum(x**2 * jax.lax.stop_gradient(x**2))),
    "root": lambda x: jax.lax.custom_root(lambda y: y**3 - x, x, lambda g, start: start, lambda g, y: y / 4),
}
HIDDEN["equinox"].def_jvp(lambda primals, tangents: (half_sine(*primals), 0.1 * tangents[0]))


@pytest.mark.parametrize("name", list(HIDDEN))
def test_declared_derivatives_are_found_where_they_hide(name):
    with pytest.raises(ValueError, match=r"f\.f: given a function with (custom_jvp_call|stop_gradient) \("):
        require_derivatives("f", HIDDEN[name], 2)


def test_what_jax_shifts_by_a_constant_is_no_obstacle():
    for f in (jax.nn.softmax, jax.nn.log_softmax, jax.scipy.special.logsumexp, jnp.sinc, jax.nn.relu6):
        require_derivatives("f", jax.jit(f), 2)


def test_signs_and_sets_take_no_declared_derivative():
    """By its formula -x1^2 + steep(x1) / 10 reaches 0.09."""
    box = Interval(np.array([-1.0]), np.array([1.0]))
    with pytest.raises(ValueError, match=r"enclosures\.f: given a function with custom_jvp_call"):
        is_negative(lambda z: steep(z[0]) / 10 - z[0] ** 2, box)
    with pytest.raises(ValueError, match=r"absorbing\.f: given a function with stop_gradient"):
        designs.absorbing(from_function(swing, first, n=2), lambda x: x @ jax.lax.stop_gradient(x), 2)


class TimedStep(plants.AbstractStepPlant):
    """x1+ = x2 / 2, x2+ = sin(k) sin(x1) / 5."""

    n = 2
    m = 0
    p = 1

    def step(self, k, x, u):
        return jnp.stack([x[1] / 2, jnp.sin(x[0]) * jnp.sin(k) / 5])

    def h(self, x, u):
        return x[:1]

    def disturbance_matrix(self):
        return jnp.eye(2)


def test_bounds_of_one_time_do_not_travel():
    found = designs.survey(TimedStep(), BOX)
    assert found.best is not None
    assert found.best.certificate is not None
    with pytest.raises(ValueError, match=r"survey\.plant: given equations that change with time"):
        found.travelling(found.best.certificate)
    assert "normal_form" not in str(structure.forms(Timed()))


def decaying(x, u):
    return [-x[0]]


def test_one_state_with_an_input_in_its_output_is_no_chain():
    found = structure.observability(
        from_function(decaying, driven_output, n=1, m=1), states=([-1.0], [1.0]), inputs=([-1.0], [1.0]), count=8
    )
    assert (found.chain, found.triangular) == ("no", "no")


def relay(x, u):
    return [x[1], -10 * jnp.sign(x[0])]


def test_a_jump_that_the_map_does_not_see_takes_no_proof_away():
    plant = from_function(relay, first, n=2)
    assert structure.observability(plant, states=BOX, count=8).regular == "proved"
    assert "no Lipschitz constant that is proved" in str(structure.forms(plant, states=BOX))


def leaning(x, u, c):
    return [x[1] + c["b"] * x[0], -x[0]]


def faded(x, u, c):
    return [x[1], jnp.exp(-c["b"] * x[0]) * x[1] - x[0]]


def seen(x, u, c):
    return x[0]


@pytest.mark.parametrize(
    ("f", "b", "relying"),
    [
        (leaning, 0.0, {"chain", "lipschitz"}),
        (leaning, 1.0, set()),
        (faded, 0.0, {"linear", "state_affine", "lipschitz"}),
        (faded, 1.0, set()),
    ],
)
def test_a_form_of_one_value_of_a_parameter_is_named(f, b, relying):
    found = structure.forms(from_function(f, seen, n=2, parameters={"b": b}))
    assert set(found.relying) == relying
    assert ("For the parameters that it has" in str(found)) == bool(relying)
    assert all(getattr(found, name) is not None for name in found.parts)  # what is listed can be made
    if f is faded and not b:
        assert found.flow.tolist() == [["0", "1"], ["c", "1"]]  # exp(0) is 1, no function of an input


def masked(x, u):
    return [x[1], jnp.max(jnp.where(jnp.array([True, False]), x, -jnp.inf))]


def cleaned(x, u):
    return [x[1], -x[0] + jnp.nan_to_num(x[0])]


def table(x, u):
    return [x[1], jnp.interp(x[0], jnp.array([-1.0, 0.0, 1.0]), jnp.array([0.0, 1.0, -1.0]))]


@pytest.mark.parametrize("f", [masked, cleaned, table])
def test_numbers_that_are_none_are_no_crash(f):
    assert structure.forms(from_function(f, first, n=2)).source
