"""Regions of proved decay: the plant is simulated from their borders, and the largest ball is known in closed form."""

import dataclasses

import numpy as np
import pytest

from jaxobs.certificates import Corners, Regional, load
from jaxobs.designs import Infeasible, corner_lmi, half_widths, regional
from jaxobs.designs.polytope import Polytope
from tests.oracles import regional as oracle

GAIN = np.array([[6.0], [12.0]])
INNER = (np.array([-2.0, -1.4]), np.array([2.0, 1.4]))


def rayleigh(reach: float) -> Polytope:
    """Slopes 1 - 3 x2^2 for |x2| <= reach."""
    a = np.array([[0.0, 1.0], [-1.0, 0.0]])
    return Polytope(a, np.eye(2)[:, 1:], np.eye(2)[1:], np.array([1 - 3 * reach**2]), np.array([1.0]), np.eye(1, 2))


def outer(reach: float):
    return np.array([-np.inf, -reach]), np.array([np.inf, reach])


def proved(reach: float, **options) -> Regional:
    return regional(rayleigh(reach), GAIN, **({"inner": INNER, "outer": outer(reach), "rate": 0.3} | options))


@pytest.mark.parametrize("aim", ["ball", "volume"])
def test_from_the_border_of_the_region_the_estimate_stays_and_the_error_decays(aim):
    reach = 2.5
    certificate = proved(reach, aim=aim)
    assert certificate.verify().margins == {"decay_rate": 0.3, "radius": certificate.radius}
    p, rng, farthest = np.array(certificate.p), np.random.default_rng(0), 0.0
    root = np.linalg.inv(np.linalg.cholesky(p)).T * np.sqrt(certificate.level)
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        e0 = root @ [np.cos(angle), np.sin(angle)]
        x0 = rng.uniform([-0.8, -0.8], [0.8, 0.8])
        ts, x, xhat = oracle.together(lambda t, x: oracle.cubic(x), oracle.cubic, GAIN[:, 0], x0, x0 - e0, 8.0)
        values = np.einsum("ti,ij,tj->t", x - xhat, p, x - xhat)
        assert np.all(np.abs(x) <= INNER[1])
        assert np.all(values <= certificate.level * np.exp(-0.6 * ts) * (1 + 1e-6))
        farthest = max(farthest, np.max(np.abs(xhat[:, 1])))
    assert farthest <= reach
    assert certificate.radius == pytest.approx(np.sqrt(certificate.level / np.linalg.eigvalsh(p)[-1]), rel=1e-6)


def test_the_region_touches_the_box():
    """sup |e2| over the ellipsoid is the half-width, and no ball is larger than the half-width."""
    certificate = proved(2.5)
    p = np.array(certificate.p)
    assert np.sqrt(certificate.level * np.linalg.inv(p)[1, 1]) == pytest.approx(1.1, rel=1e-6)
    assert certificate.radius < 1.1


def test_a_ball_is_found_where_it_is_known():
    """F = -2 I for all parameters: e'e falls, so that the ball touches the box."""
    model = Polytope(-2 * np.eye(2), np.zeros((2, 0)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.eye(1, 2))
    for aim in ("ball", "volume"):
        found = regional(
            model, np.zeros((2, 1)), inner=(-np.ones(2), np.ones(2)), outer=(-3 * np.ones(2), 3 * np.ones(2)), aim=aim
        )
        assert found.radius == pytest.approx(2.0, rel=1e-4)


def test_what_is_optimised_is_larger():
    ball, volume = proved(2.5, aim="ball"), proved(2.5, aim="volume")
    area = [one.level / np.sqrt(np.linalg.det(np.array(one.p))) for one in (ball, volume)]
    plain = corner_lmi.prove(rayleigh(2.5), GAIN, rate=0.3)
    assert isinstance(plain, Corners)
    p = np.array(plain.p)
    level = 1.1**2 / np.linalg.inv(p)[1, 1]
    assert ball.radius >= volume.radius >= 0
    assert area[1] >= area[0]
    assert ball.radius > np.sqrt(level / np.linalg.eigvalsh(p)[-1])


def test_points_and_faces():
    """S as points has their extremes; faces of other directions are half-spaces; boxes without end take no part."""
    points = np.array([[0.5, -1.4], [-2.0, 0.3], [2.0, 1.4]])
    assert proved(2.5, inner=points) == proved(2.5)
    certificate = proved(2.5)
    assert certificate.faces == ((0.0, 1.0),)
    turned = proved(
        2.5, inner=(np.array([-1.4]), np.array([1.4])), outer=(np.array([-2.5]), np.array([2.5])), faces=[[0.0, 1.0]]
    )
    assert turned.radius == pytest.approx(certificate.radius, rel=1e-6)
    np.testing.assert_array_equal(half_widths(INNER, outer(2.5)), [np.inf, 1.1])
    np.testing.assert_allclose(half_widths(([0.0], [1.0]), ([-3.0], [1.5])), [0.5])
    np.testing.assert_allclose(half_widths(([0.0, -np.inf], [1.0, np.inf]), ([-np.inf] * 2, [1.5, np.inf])), [0.5, np.inf])
    one_sided = proved(2.5, outer=(np.array([-np.inf, -np.inf]), np.array([np.inf, 2.5])))
    assert one_sided.radius == pytest.approx(certificate.radius, rel=1e-6)


def test_an_injected_innovation_narrows_what_the_channel_sees():
    """With inner k the slope meets e2 - k e1: the region is that of a model with this row."""
    model, k = rayleigh(2.5), np.array([[-0.5]])
    found = proved(2.5, injection=k)
    other = dataclasses.replace(model, c=model.c - k @ model.output)
    same = regional(other, GAIN, inner=INNER, outer=outer(2.5), rate=0.3)
    assert found.inner == ((-0.5,),)
    assert found.radius == pytest.approx(same.radius, rel=1e-6)
    assert found.radius != pytest.approx(proved(2.5).radius, rel=1e-3)


def test_anything_worse_is_refused(tmp_path):
    certificate = proved(2.5)
    certificate.to_json(tmp_path / "c.json")
    again = load(tmp_path / "c.json")
    assert again == certificate
    assert again.verify()
    for change in (
        {"level": certificate.level * 1.01},
        {"radius": certificate.radius * 1.01},
        {"inner_upper": (1.5,)},
        {"inner_upper": (2.5,)},
        {"inner_lower": (-2.6,)},
        {"inner_lower": (1.9,), "inner_upper": (-1.9,)},
        {"outer_upper": (2.4,)},
        {"rate": 5.0},
        {"lower": (-60.0,)},
        {"level": -1.0},
        {"radius": -1.0},
        {"faces": ((1.0, 0.0), (0.0, 1.0))},
        {"faces": ((0.0, 2.0),)},
    ):
        verdict = dataclasses.replace(certificate, **change).verify()
        assert not verdict, change
        assert verdict.why.startswith("not certified")
    assert dataclasses.replace(certificate, level=certificate.level / 2, radius=certificate.radius / 2).verify()


def test_gains_that_prove_nothing():
    with pytest.raises(Infeasible, match="decay rate"):
        proved(2.5, rate=50.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"aim": "area"}, "regional.aim: given 'area'; expected 'ball' or 'volume'"),
        ({"inner": ([-1, -2.5], [1, 2.5])}, r"regional.inner: given \[-2.5, 2.5\] against \[-2.5, 2.5\] along side 1"),
        ({"outer": ([-np.inf] * 2, [np.inf] * 2)}, "regional.outer: given no finite side; .*corner_lmi.prove"),
        ({"inner": ([-1, -np.inf], [1, 1])}, "regional.inner: given .*along side 1"),
        (
            {"inner": ([-1, -np.inf], [1, 1]), "outer": ([-np.inf] * 2, [np.inf, 2])},
            "regional.inner: .* finite sides where outer",
        ),
        ({"outer": ([-2.5], [2.5])}, "regional.outer: given 1 sides; expected 2"),
        ({"inner": ([1, 1], [-1, -1])}, r"regional.inner: given .*; expected \(lower, upper\) with lower <= upper"),
        ({"inner": np.zeros((0, 2))}, "regional.inner: given shape .*points"),
        ({"faces": [[1.0, 0.0, 0.0]]}, "regional.faces: given shape .* expected finite rows of length 2"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        proved(2.5, **change)
