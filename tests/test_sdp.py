"""The SDP core: what it returns is feasible by its own arithmetic, what it bounds cannot be exceeded."""

import numpy as np
import pytest

from jaxobs.designs import sdp


def test_the_smallest_eigenvalue():
    m = np.array([[2.0, 1.0, 0.0], [1.0, -3.0, 0.5], [0.0, 0.5, 1.0]])
    found = sdp.optimise({"t": sdp.scalar()}, lambda t: [m - t * np.eye(3)], maximise=lambda t: t, margin=0.0)
    lowest = np.linalg.eigvalsh(m)[0]
    assert found.value == pytest.approx(lowest, abs=1e-7)
    assert found.bound == pytest.approx(lowest, abs=1e-6)
    assert found.bound >= lowest - 1e-12


def test_an_affine_objective_with_a_known_optimum():
    """min x + y with [[x, 1], [1, y]] >= 0 is 2."""
    unknowns = {"x": sdp.scalar(), "y": sdp.scalar()}
    found = sdp.optimise(unknowns, lambda x, y: [np.array([[x, 1.0], [1.0, y]])], maximise=lambda x, y: 5 - x - y)
    assert found.value == pytest.approx(3, abs=1e-6)
    assert found.is_feasible
    assert found.values["x"].shape == ()


def test_matrices_come_back_in_their_shapes():
    a, c = np.eye(3, k=1), np.eye(1, 3)
    unknowns = {"p": sdp.symmetric(3, trace=3.0), "y": sdp.full(1, 3)}
    found = sdp.feasible(unknowns, lambda p, y: [p, -(a.T @ p + p @ a - y.T @ c - c.T @ y)])
    p, y = found.values["p"], found.values["y"]
    assert found.is_feasible
    assert not found.is_infeasible
    assert (p == p.T).all()
    assert np.trace(p) == pytest.approx(3)
    assert max(np.linalg.eigvals(a - np.linalg.solve(p, y.T) @ c).real) < 0
    recomputed = min(np.linalg.eigvalsh(f)[0] for f in (p, -(a.T @ p + p @ a - y.T @ c - c.T @ y)))
    assert found.margin == pytest.approx(recomputed, abs=1e-12)
    assert found.margin <= found.bound + 1e-9


def test_an_unstable_matrix_has_a_dual_bound_below_zero():
    a = np.array([[0.1, 1.0], [0.0, -2.0]])
    unknowns = {"p": sdp.symmetric(2), "t": sdp.scalar()}
    found = sdp.optimise(
        unknowns, lambda p, t: [p - np.eye(2), -(a.T @ p + p @ a) - t * np.eye(2)], maximise=lambda p, t: t, margin=0.0
    )
    # v = (1, 0): v'(A'P + P A) v = 0.2 p_11 >= 0.2 for every P >= I
    assert found.bound == pytest.approx(-0.2, abs=1e-4)
    assert found.is_infeasible


def test_the_edge_of_feasibility_is_neither():
    """A centre has no P with strict decrease, and no P misses by any fixed amount: both answers stay open."""
    a = np.array([[0.0, 1.0], [-1.0, 0.0]])
    found = sdp.feasible({"p": sdp.symmetric(2, trace=2.0)}, lambda p: [p, -(a.T @ p + p @ a)])
    assert abs(found.margin) < 1e-6
    assert abs(found.bound) < 1e-6


def test_duals_are_stationary_and_bound_every_point():
    rng = np.random.default_rng(0)
    for _ in range(10):
        blocks = [(lambda m: m + m.T)(rng.normal(size=(3, 3, 3))) for _ in range(2)]
        unknowns = {"x": sdp.full(3, 1, reach=2.0)}
        slopes = [np.stack([(g + g.T) / 2 for g in block]) for block in blocks]

        def lmis(x, slopes=slopes):
            return [np.eye(3) + np.tensordot(x[:, 0], s, 1) for s in slopes]

        direction = rng.normal(size=3)
        found = sdp.optimise(unknowns, lmis, maximise=lambda x, d=direction: d @ x[:, 0], margin=0.0)
        assert found.value <= found.bound + 1e-9
        assert found.bound == pytest.approx(found.value, abs=1e-5)
        for x in rng.uniform(-2, 2, size=(200, 3, 1)):
            if min(np.linalg.eigvalsh(f)[0] for f in lmis(x)) >= 0:
                assert direction @ x[:, 0] <= found.bound + 1e-12
