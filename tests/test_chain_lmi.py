"""designs.chain_lmi: how far (31)-(32) reach, against closed forms in the plane and Lyapunov equations."""

import cvxpy as cp
import numpy as np
import pytest
from chain_cases import BOUNDS, GAIN, plant
from oracles import chain_lmi as oracle

from jaxobs.designs import high_gain_lmi, smallest_theta
from jaxobs.designs.chain_lmi import corners, gain_constant, largest_lambda, triangle_constant
from jaxobs.designs.chain_proofs import certify, refute


@pytest.mark.parametrize("j0", [0, 1])
@pytest.mark.parametrize(("m1", "m2"), [(1.0, 0.0), (1.0, 0.3), (0.4, 3.0), (20.0, 7.0), (0.1, 0.1)])
def test_smallest_theta_in_the_plane(m1, m2, j0):
    found = smallest_theta([[-m1, m1 / 2], [-m2, m2]], j0)
    exact = oracle.smallest_theta_in_the_plane(m1, m2, j0)
    assert found.theta == pytest.approx(exact, rel=1e-5)
    assert found.refuted <= exact * (1 + 1e-12)
    assert found.refuted == (0.0 if exact == 1 else pytest.approx(exact, rel=1e-5))


@pytest.mark.parametrize("gain", [(3.0, 3.0, 1.0), (4.0, 6.0, 4.0), (2.0, 2.0, 1.0)])
def test_one_matrix_is_a_lyapunov_equation(gain):
    constant = 2.5
    found = smallest_theta(BOUNDS, 0, gain=gain, constant=constant)
    assert found.theta == pytest.approx(oracle.one_corner_theta(gain, np.zeros(3), constant, 0), rel=1e-5)
    row = corners(BOUNDS, 2, 8.0)[-1]
    assert np.linalg.eigvals(np.eye(3, k=1) + np.outer([0, 0, 1], row) - np.outer(gain, [1, 0, 0])).real.max() < 0
    lam = largest_lambda(row[None], np.array(gain))
    assert lam.attained == pytest.approx(2 * 0.5 / oracle.one_corner_theta(gain, row, 0.5, 0, sigma=0.0), rel=1e-6)
    assert lam.attained <= lam.bound * (1 + 1e-9)


@pytest.mark.parametrize("gain", [None, np.array(GAIN)])
def test_lambda_agrees_with_the_problem_written_out(gain):
    rows = corners(BOUNDS, 2, 6.0)
    p, lam, y = cp.Variable((3, 3), symmetric=True), cp.Variable(), cp.Variable((1, 3))
    c = np.eye(1, 3)
    constraints = [p >> 0, np.eye(3) - p >> 0, cp.norm(y) <= 1e4]
    for row in rows:
        a = np.eye(3, k=1)
        a[-1] += row
        sides = p @ a - y.T @ c if gain is None else p @ (a - np.outer(gain, c))
        constraints.append(sides + sides.T + lam * np.eye(3) << 0)
    cp.Problem(cp.Maximize(lam), constraints).solve(solver=cp.CLARABEL)
    found = largest_lambda(rows, gain)
    assert found.attained == pytest.approx(float(lam.value), rel=2e-3 if gain is None else 1e-6)  # |Y| <= 1e4 costs a little
    assert found.attained <= found.bound <= found.attained * (1 + 1e-6)


@pytest.mark.parametrize("j0", [0, 1, 2])
@pytest.mark.parametrize("gain", [None, GAIN])
def test_both_sides_of_the_edge_are_proved(j0, gain):
    found = smallest_theta(BOUNDS, j0, gain=gain)
    assert found.theta * (1 - 1e-4) < found.refuted < found.theta
    below = refute(BOUNDS, j0, found.refuted * (1 - 1e-5), gain=gain)
    assert below.verify()
    assert oracle.refutes(below)
    if gain is not None:
        theta = found.theta * (1 + 1e-5)
        above = certify(BOUNDS, j0, theta, np.array(gain) * theta ** np.arange(1, 4))
        assert above.verify()
        assert oracle.holds_hg_lmi(above)
        assert refute(BOUNDS, j0, theta, gain=gain) is None


def test_no_theta_for_a_gain_without_stability():
    found = smallest_theta(BOUNDS, 1, gain=(1.0, 1.0, 2.0))
    assert found.theta == found.refuted == np.inf
    assert not oracle.is_hurwitz((1.0, 1.0, 2.0))


def test_with_all_slopes_by_corners_every_theta_will_do():
    assert smallest_theta(BOUNDS, 3).theta == 1.0
    for theta in (1.0, 4.0):
        _, proof = high_gain_lmi(plant(), bounds=BOUNDS, j0=3, theta=theta)
        assert oracle.holds_hg_lmi(proof)


def test_constants_bound_the_ratio_and_are_attained():
    rng = np.random.default_rng(0)
    sizes = np.abs(BOUNDS).max(axis=1)
    for j0 in range(4):
        for theta in (1.0, 2.0, 9.0):
            last, k = 3 - j0, gain_constant(BOUNDS, j0, theta)
            psi, e = rng.choice([-1, 1], (500, last)) * sizes[:last], rng.normal(size=(500, 3))
            load = np.abs(np.sum(psi * theta ** np.arange(1, last + 1) * e[:, :last], axis=1)) / theta**3
            assert np.all(load <= k / theta**j0 * np.linalg.norm(e, axis=1))
            direction = sizes[:last] * theta ** np.arange(1.0, last + 1)
            worst = direction @ direction / theta**3 / max(np.linalg.norm(direction), 1e-300)
            assert worst == pytest.approx(k / theta**j0, rel=1e-12)
            assert k <= triangle_constant(BOUNDS, j0) * (1 + 1e-12)


def test_corners_are_those_of_27():
    rows = corners(BOUNDS, 2, 2.0)
    assert rows.tolist() == [[0, -0.125, 0], [0, -0.125, 0.75], [0, 0.125, 0], [0, 0.125, 0.75]]
    assert corners(BOUNDS, 0, 2.0).tolist() == [[0, 0, 0]]
    assert len(corners([[-1, 1], [0, 0], [-1, 1]], 3, 1.0)) == 4  # a pair without width has one value
