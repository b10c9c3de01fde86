"""Floors that no observer beats, against closed forms and scipy's Riccati solver."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from jaxobs import designs
from jaxobs.certificates import load
from jaxobs.designs import Infeasible, corner_lmi, kalman_floor
from jaxobs.designs.polytope import Polytope

RNG = np.random.default_rng(3)


def chain(n, slope):
    bound = np.full(n, float(slope))
    return Polytope(np.eye(n, k=1), np.tile(np.eye(n)[:, -1:], (1, n)), np.eye(n), -bound, bound, np.eye(1, n))


def scalar(low, high):
    """e' = rho e + q w, y = e + r v."""
    return Polytope(np.zeros((1, 1)), np.eye(1), np.eye(1), np.array([low]), np.array([high]), np.eye(1))


@pytest.mark.parametrize(("high", "q", "r"), [(1.0, 0.3, 0.2), (0.5, 0.0, 2.0), (-0.5, 1.0, 1.0)])
def test_one_state_in_closed_form(high, q, r):
    """S = r^2 (rho + sqrt(rho^2 + q^2 / r^2)), largest at the largest rho."""
    found = kalman_floor(scalar(-1.0, high), np.eye(1), [[q]], [[r]])
    assert found.rho == (high,)
    assert found.level == pytest.approx(r**2 * (high + np.sqrt(high**2 + q**2 / r**2)), rel=1e-6)
    assert found.verify()


@pytest.mark.parametrize("n", [2, 4])
def test_the_floor_is_the_riccati_solution_at_the_worst_corner(n):
    model = chain(n, 1 / n)
    weight, process = RNG.normal(size=(2, n)), np.eye(n)[:, -1:]
    found = kalman_floor(model, weight, process, [[0.5]], search=False)
    levels = []
    for a in model.corners():
        s = solve_continuous_are(a.T, model.output.T, process @ process.T, [[0.25]])
        levels.append(np.trace(weight @ s @ weight.T))
    assert found.level <= max(levels)
    assert found.level == pytest.approx(max(levels), rel=1e-6)
    assert kalman_floor(model, weight, process, [[0.5]]).level >= found.level * (1 - 1e-9)


def test_no_gain_is_below_the_floor():
    """The variance of frozen observers by Lyapunov's equation, for many gains and the certified one."""
    model, process, noise = chain(3, 0.5), np.eye(3), np.array([[0.3]])
    found = kalman_floor(model, np.eye(3), process, noise)
    best, _ = corner_lmi.synthesise(model, process=process @ process.T, noise=noise @ noise.T)
    a = model.at(np.array(found.rho))
    kalman = solve_continuous_are(a.T, model.output.T, process @ process.T, noise @ noise.T) @ model.output.T / 0.09
    ratios = []
    for gain in [best, *(kalman * np.exp(RNG.normal(size=(3, 1)) * size) for size in np.linspace(0, 0.5, 30))]:
        f = a - gain @ model.output
        if np.max(np.linalg.eigvals(f).real) < 0:
            x = solve_continuous_lyapunov(f, -process @ process.T - 0.09 * gain @ gain.T)
            ratios.append(np.trace(x) / found.level)
    assert len(ratios) > 20
    assert min(ratios) >= 1
    assert min(ratios) < 1 + 1e-6  # the Kalman gain itself is among them


def test_the_certificate_travels_and_is_tight(tmp_path):
    found = kalman_floor(chain(2, 0.5), np.eye(2), np.eye(2)[:, 1:], [[1.0]])
    found.to_json(tmp_path / "k.json")
    assert load(tmp_path / "k.json") == found
    changes = [
        ({"level": found.level * 1.001}, "tr E S E' >= level"),
        ({"noise": ((0.99,),)}, "the Riccati inequality"),
        ({"process": ((0.0,), (0.99,))}, "the Riccati inequality"),
        ({"s": tuple(tuple(1.001 * x for x in row) for row in found.s)}, "the Riccati inequality"),
        ({"rho": (2.0, 0.5)}, "the box"),
        ({"noise": ((0.0,),)}, "V > 0"),
    ]
    for change, why in changes:
        verdict = dataclasses.replace(found, **change).verify()
        assert not verdict
        assert why in verdict.why


def test_a_worse_parameter_inside_the_box_is_found():
    """The output sees least of the state at rho = 0.3: e_1' = (rho - 0.3) e_2 drives what is measured."""
    model = Polytope(
        np.array([[0.0, -0.3], [0.0, 0.2]]), np.eye(2)[:, :1], np.eye(2)[1:], np.array([-1.0]), np.array([0.25]), np.eye(1, 2)
    )
    found = kalman_floor(model, np.eye(2), np.eye(2), [[0.1]])
    assert found.rho[0] == pytest.approx(0.25)  # the nearest to 0.3
    wide = dataclasses.replace(model, upper=np.array([0.29]), lower=np.array([-0.5]))
    assert kalman_floor(wide, np.eye(2), np.eye(2), [[0.1]]).level > found.level


def test_where_there_is_no_floor():
    """A marginal error that nothing excites can be estimated without limit; without a filter there is no finite floor."""
    with pytest.raises(Infeasible, match="no positive floor could be proved"):
        kalman_floor(chain(2, 0.0), np.eye(2), np.zeros((2, 1)), [[1.0]])
    blind = Polytope(np.diag([0.5, -1.0]), np.zeros((2, 0)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.eye(2)[1:])
    with pytest.raises(Infeasible, match="no positive floor"):
        kalman_floor(blind, np.eye(2), np.eye(2), [[1.0]])
    assert designs.undetectable(blind) is not None


@pytest.mark.usefixtures("as_users_have_it")
def test_bad_noises_are_refused():
    model = chain(2, 0.5)
    with pytest.raises(ValueError, match=r"kalman_floor\.process: given shape \(1, 2\); expected a finite matrix"):
        kalman_floor(model, np.eye(2), np.ones((1, 2)), [[1.0]])
    with pytest.raises(ValueError, match=r"kalman_floor\.noise: given \[\[0.0\]\]; expected V with V V' > 0"):
        kalman_floor(model, np.eye(2), np.eye(2), [[0.0]])
    with pytest.raises(ValueError, match=r"kalman_floor\.points: given \[2.0, 0.0\]; expected parameters within the box"):
        kalman_floor(model, np.eye(2), np.eye(2), [[1.0]], points=[[2.0, 0.0]])
