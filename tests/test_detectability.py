"""designs.undetectable: points no gain can help, against the Hautus test."""

import dataclasses

import numpy as np
import pytest
from lpv_cases import HIGH, LORENZ, LOW, T, arrays
from oracles import lpv

from jaxobs import designs, plants
from jaxobs.designs import Infeasible, corner_lmi, lpv_lmi, lpv_model, midpoint_channels, slope_entries
from jaxobs.designs.polytope import Polytope
from jaxobs.integrators import Euler
from jaxobs.plants import Discretised

RNG = np.random.default_rng(7)


def rossler(output, low=(0.0, -9.2), high=(23.0, 11.5)):
    plant = plants.Rossler(output=output)
    return lpv_model(plant, slope_entries([[low[0], 0, low[1]]], [[high[0], 0, high[1]]]))


UNDETECTABLE = {
    "Roessler, y = x1: x1 - c = a": (rossler([[1, 0, 0]]), 0.2, {1: 5.9}),
    "Roessler, y = x3: x3 = 0": (rossler([[0, 0, 1]]), 0.1, {0: 0.0}),
    "Van der Pol, y = x2: 2 mu x1 x2 = -1": (
        lpv_model(plants.VanDerPolSeen(output=[[0, 1]]), slope_entries([[-9, 0]], [[9, 4]])), 0.0, {0: -1.0}),
    "Lorenz, y = x3 on the axis": (
        arrays(Polytope, LORENZ.a(), np.eye(3)[:, :1], np.eye(3)[1:2], [-3], [4], np.eye(3)[2:]), None, {}),
}  # fmt: skip


@pytest.mark.parametrize("name", UNDETECTABLE)
def test_undetectable_points_are_named(name):
    model, growth, coordinates = UNDETECTABLE[name]
    point = designs.undetectable(model)
    assert point.is_exact
    assert ((model.lower <= point.rho) & (point.rho <= model.upper)).all()
    for place, value in coordinates.items():
        assert point.rho[place] == pytest.approx(value, abs=1e-12)
    a = model.at(np.asarray(point.rho))
    seen = [s for s in lpv.unobservable_modes(a, model.output) if s.real > -1e-9]
    assert min(abs(s - point.eigenvalue) for s in seen) < 1e-6
    assert growth is None or point.eigenvalue.real == pytest.approx(growth, abs=1e-12)
    v = np.asarray(point.direction)
    np.testing.assert_allclose(a @ v, point.eigenvalue * v, atol=1e-9)
    np.testing.assert_allclose(model.output @ v, 0, atol=1e-12)


def test_no_gain_helps_there():
    """With any L the frozen error keeps the mode."""
    model, *_ = UNDETECTABLE["Roessler, y = x1: x1 - c = a"]
    a = model.at(np.asarray(designs.undetectable(model).rho))
    for gain in RNG.normal(size=(50, 3, 1)) * 10 ** RNG.uniform(-2, 4, (50, 1, 1)):
        assert np.max(np.linalg.eigvals(a - gain @ model.output).real) > 0.2 - 1e-6


def test_nothing_is_named_where_every_point_is_observable():
    plant = Discretised(LORENZ, Euler(), T)
    assert designs.undetectable(lpv_model(plant, midpoint_channels(LORENZ, LOW, HIGH)), step=True) is None
    assert designs.undetectable(rossler([[0, 1, 0]])) is None


def test_a_decaying_hidden_mode_counts_only_against_faster_rates():
    """x1' = -x1 unseen: detectable, but not at rate 2; and for steps likewise."""
    a = np.diag([-1.0, 1.0])
    model = arrays(Polytope, a, np.zeros((2, 0)), np.zeros((0, 2)), [], [], [[0.0, 1.0]])
    assert designs.undetectable(model) is None
    assert designs.undetectable(model, rate=2.0).eigenvalue == -1
    step = dataclasses.replace(model, a=np.diag([0.5, 2.0]))
    assert designs.undetectable(step, step=True) is None
    assert designs.undetectable(step, rate=0.4, step=True).eigenvalue == 0.5


def test_an_irrational_point_is_found_in_floats():
    """(a, c) with a = [[1, rho^... ]]: x1 is seen through rho^2 - 2 only, by two tied channels in series."""
    a = np.array([[1.0, 0, 0], [0, -3, 0], [-2.0, 0, -5]])
    b, c = np.array([[0, 0], [1, 0], [0, 1.0]]), np.array([[1.0, 0, 0], [0, 1, 0]])
    # x2' = -3 x2 + rho x1, x3' = -5 x3 + rho x2 - 2 x1: at the mode s = 1 x3 sees (rho^2 / 4 - 2) x1, zero at rho = sqrt 8
    model = arrays(Polytope, a, b, c, [1.0, 1.0], [3.0, 3.0], [[0, 0, 1.0]], tied=(0, 0))
    point = designs.undetectable(model)
    assert not point.is_exact
    assert point.rho[0] == point.rho[1] == pytest.approx(np.sqrt(8))
    assert point.eigenvalue == pytest.approx(1)


def test_undetectable_points_come_before_any_solve(monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("solved")

    monkeypatch.setattr(corner_lmi, "synthesise", never)
    with pytest.raises(Infeasible, match=r"undetectable at rho = .*, 5\.9\), exactly.*whatever|measure something else"):
        lpv_lmi(plants.Rossler(output=[[1, 0, 0]]), bounds=([[0, 0, -9.2]], [[23.0, 0, 11.5]]))
