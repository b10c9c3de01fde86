"""From systems to error dynamics with proved parameters: the factoring, the bounds, and the examples of paper 004."""

import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import integrators, plants
from jaxobs.certificates import with_bounds
from jaxobs.designs import Box, Infeasible, band, corner_lmi, everywhere, lpv_from, lpv_lmi, lpv_model, proved_channels
from jaxobs.designs import saturated as saturate
from jaxobs.designs._factor import factor, separate
from jaxobs.papers.p004.paper import DUFFING_SLOPE, JOINT_GAIN, LORENZ_GAIN

PRINTED = 8.34  # 3 d^2 to which the printed gain of the flexible joint holds
LORENZ_BOX = ([-30.0, -30.0, -2.0], [30.0, 30.0, 58.0])


def joint(slope, channels="auto"):
    """The flexible joint for 3 d^2 <= slope, d = theta_l - theta_m, at any angle."""
    angle = math.sqrt(slope / 3)
    twist = band([[-1.0, 0.0, 1.0, 0.0]], [-angle], [angle])
    return lpv_from(plants.FlexibleJoint(), None, twist, channels, inputs=([-1.0], [1.0]))


def slopes_at(f, points):
    return np.asarray(jax.vmap(jax.jacfwd(f))(jnp.asarray(points)))


def require_hull(lpv, f, points):
    """Every sampled Jacobian is the model at parameters inside the bounds."""
    model = lpv.model
    names = sorted(set(model.tied))
    parts = np.stack([sum(np.outer(model.b[:, k], model.c[k]) for k in range(model.r) if model.tied[k] == g) for g in names])
    first = [model.tied.index(g) for g in names]
    for slope in slopes_at(f, points):
        rest = (slope - model.a).ravel()
        rho, *_ = np.linalg.lstsq(parts.reshape(len(names), -1).T, rest, rcond=None)
        scale = max(1.0, float(np.max(np.abs(slope))))
        assert np.max(np.abs(parts.reshape(len(names), -1).T @ rho - rest)) < 1e-11 * scale
        assert np.all(rho >= model.lower[first] - 1e-9 * scale)
        assert np.all(rho <= model.upper[first] + 1e-9 * scale)


def test_factors_are_found_exactly():
    """Entries 3 x, -3 x, 3 y and -3 y + z of one term have rank one; a sum in one entry is one parameter."""
    x, y, z = (Fraction(value) for value in (270.27027027027026, 107.52688172043011, -33.22742))
    joint_table = {
        (1, 0): ((0, -3 * x),),
        (1, 2): ((0, 3 * x),),
        (3, 0): ((0, 3 * y),),
        (3, 2): ((0, -3 * y), (1, z)),
    }
    spring, weight = factor(joint_table)
    assert [len(one.channels()) for one in (spring, weight)] == [1, 1]
    ((b, c),) = spring.channels()
    assert {(i, j): p * q * spring.terms[0][1] for i, p in b.items() for j, q in c.items()} == {
        (1, 0): -3 * x,
        (1, 2): 3 * x,
        (3, 0): 3 * y,
        (3, 2): -3 * y,
    }
    assert len(factor({(1, 0): ((0, Fraction(1)), (1, Fraction(-1)))})) == 1
    assert len(separate(joint_table)) == 4


@pytest.mark.slow
def test_the_flexible_joint_has_four_corners_instead_of_sixteen():
    auto, entries = joint(3.0), joint(3.0, "entries")
    assert [len(one.model.corners()) for one in (auto, entries)] == [4, 16]
    assert auto.model.r == 2  # two channels of rank one
    assert "cos(x3)" in auto.parameters[1]
    plant = plants.FlexibleJoint()
    rng = np.random.default_rng(0)
    points = rng.uniform(-3, 3, size=(50, 4))
    points[:, 2] = points[:, 0] + rng.uniform(-1, 1, size=50)
    for one in (auto, entries):
        require_hull(one, lambda x: plant.flow(jnp.asarray(0.0), x, jnp.zeros(1)), points)
    gains = [np.linalg.norm(corner_lmi.synthesise(one.model, rate=4.0)[0]) for one in (auto, entries)]
    assert gains[0] < gains[1] / 2


def test_the_printed_joint_gain_holds_to_its_figure_and_not_much_further():
    found = joint(PRINTED)
    assert found.model.upper[0] == pytest.approx(PRINTED, rel=1e-12)
    assert found.conditional
    certificate = corner_lmi.prove(found.model, np.asarray(JOINT_GAIN), origin=found.origin)
    assert certificate.verify()
    assert "conditional on the state staying in -x1 + x3" in certificate.origin
    assert "conditional on its estimate" in certificate.origin
    with pytest.raises(Infeasible):
        corner_lmi.prove(joint(8.5).model, np.asarray(JOINT_GAIN))


@pytest.mark.slow
def test_duffing_and_lorenz_of_the_paper():
    edge = math.sqrt(DUFFING_SLOPE / 3)
    duffing = lpv_from(plants.ForcedDuffing(), None, ([-edge, -math.inf], [edge, math.inf]), inputs=([-11.0], [11.0]))
    assert duffing.model.r == 1
    assert (duffing.model.b @ duffing.model.c)[1, 0] * duffing.model.upper[0] == pytest.approx(-DUFFING_SLOPE, rel=1e-12)
    lorenz = lpv_from(plants.Lorenz(), None, LORENZ_BOX)
    assert len(lorenz.model.corners()) == 8  # x1 enters twice, tied
    assert lorenz.model.r == 4
    require_hull(
        lorenz, lambda x: plants.Lorenz().flow(0.0, x, jnp.zeros(0)), np.random.default_rng(0).uniform(*LORENZ_BOX, (50, 3))
    )
    step = lpv_from(plants.Discretised(plants.Lorenz(), integrators.Euler(), jnp.asarray(0.001)), None, LORENZ_BOX)
    assert step.step
    certificate = corner_lmi.prove(step.model, np.asarray(LORENZ_GAIN), step=True, origin=step.origin)
    assert certificate.verify()


def test_the_pendulum_has_a_global_certificate():
    """|cos x - u sin x| <= sqrt(1 + u^2) for every x: nothing is assumed of the state."""
    found = lpv_from(plants.Pendulum(), None, everywhere(2), inputs=([-0.5], [0.5]))
    assert not found.conditional
    assert found.model.upper[0] == pytest.approx(math.sqrt(1.25), rel=2e-6)
    assert found.model.upper[0] >= math.sqrt(1.25)
    assert found.gap < 1.001e-6
    _, certificate = corner_lmi.synthesise(found.model, rate=1.0, origin=found.origin)
    assert certificate.verify()
    assert "conditional" not in certificate.origin
    assert "for every state" in certificate.origin


def test_plain_functions_and_rounded_coefficients():
    third = 1 / 3

    def f(x, u):
        return jnp.stack([x[1] * third, -jnp.sin(x[0]) * 0.1 * u[0] - 0.7 * jnp.sin(x[0]) * u[0] + x[0] ** 2 * 0.1])

    found = lpv_from(f, [[1.0, 0.0]], ([-1.0, -1.0], [1.0, 1.0]), inputs=([1.0], [2.0]))
    assert found.model.r == 1
    require_hull(found, lambda x: f(x, jnp.asarray([1.7])), np.random.default_rng(0).uniform(-1, 1, (20, 2)))
    assert found.model.a[0, 1] == third
    assert "u1 in [1, 2]" in found.origin


def test_saturated_plants_leave_the_estimate_free():
    """f(x) - f(sat z) against the channels, x in the box and z far outside."""
    plant = plants.Lorenz()
    cut = saturate(plant, Box(*LORENZ_BOX))
    channels = proved_channels(cut, LORENZ_BOX)
    assert channels.lower.tolist() == [-2.0, -30.0, -30.0, -30.0]
    assert channels.upper.tolist() == [58.0, 30.0, 30.0, 30.0]
    model = lpv_model(cut, channels)
    assert len(model.corners()) == 16
    assert "its estimate is anything" in channels.origin
    rng = np.random.default_rng(0)
    low, high = (np.array(end) for end in LORENZ_BOX)
    for _ in range(100):
        x, z = rng.uniform(low, high), rng.normal(size=3) * 200
        d = np.divide(x - np.clip(z, low, high), x - z)  # the diagonal of D
        mean = (x + np.clip(z, low, high)) / 2  # f is quadratic: J is the slope there
        rho = np.array([mean[2] * d[0], mean[1] * d[0], mean[0] * d[1], mean[0] * d[2]])
        assert np.all((rho >= channels.lower) & (rho <= channels.upper))
        jump = np.asarray(cut.f(jnp.asarray(x)) - cut.f(jnp.asarray(z)))
        assert np.allclose(channels.left @ (rho * (channels.right @ (x - z))), jump, rtol=1e-12, atol=1e-9)


@pytest.mark.slow
def test_channels_serve_the_design_of_the_paper():
    chain = proved_channels(plants.Pendulum(), everywhere(2), inputs=([-0.5], [0.5]))
    assert chain.complete
    _, certificate = lpv_lmi(plants.Pendulum(), bounds=chain, rate=1.0)
    assert certificate.verify()
    assert certificate.origin == chain.origin


def test_what_cannot_be_bounded_or_modelled_is_named():
    with pytest.raises(ValueError, match=r"nothing bounds df2/dx1: x3 in \[-inf, inf\].*smaller box.*saturate"):
        lpv_from(plants.Lorenz(), None, everywhere(3))
    with pytest.raises(ValueError, match=r"lpv_from\.channels: given 'some'; expected one of \['auto', 'entries'\]"):
        lpv_from(plants.Lorenz(), None, LORENZ_BOX, "some")
    with pytest.raises(ValueError, match=r"lpv_from\.C: .*expected a matrix"):
        lpv_from(lambda x: -x, None, ([0.0], [1.0]))
    with pytest.raises(ValueError, match=r"lpv_from\.inputs: .*no inputs"):
        lpv_from(lambda x, u: -x, [[1.0]], ([0.0], [1.0]))
    with pytest.raises(ValueError, match="proved_channels"):
        lpv_from(saturate(plants.Lorenz(), Box(*LORENZ_BOX)), None, LORENZ_BOX)
    with pytest.raises(ValueError, match="inside the saturation box"):
        proved_channels(saturate(plants.Lorenz(), Box(*LORENZ_BOX)), ([-31.0, -30.0, -2.0], LORENZ_BOX[1]))
    with pytest.raises(ValueError, match="Jacobian of shape"):
        lpv_from(lambda x: x[:1], [[1.0, 0.0]], ([0.0, 0.0], [1.0, 1.0]))


@pytest.mark.slow
def test_bounds_with_room_travel_in_the_certificate():
    plant = plants.Pendulum()

    def f(x, u):
        return plant.flow(jnp.asarray(0.0), x, u)

    tight, wide = (lpv_from(f, [[1.0, 0.0]], ([-4.0, -1.0], [4.0, 1.0]), inputs=([-0.5], [0.5]), room=r) for r in (0.0, 0.01))
    width = tight.model.upper[0] - tight.model.lower[0]
    assert wide.model.upper[0] == pytest.approx(tight.model.upper[0] + 0.01 * width, rel=1e-12)
    _, certificate = corner_lmi.synthesise(wide.model, rate=1.0, origin=wide.origin)
    assert with_bounds(certificate, f, np.array([-4.0, -1.0, -0.5]), np.array([4.0, 1.0, 0.5])).verify()
