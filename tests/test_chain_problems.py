"""The chains of paper 002, any n and k_f: a gain and an exact certificate for each, and how long the exact check takes."""

import time

import numpy as np
import pytest

from jaxobs.certificates import Corners
from jaxobs.designs import corner_lmi
from jaxobs.designs.polytope import Polytope

RATE = 1.0  # 1/s


def chain(n, k_f):
    """x_i' = x_{i+1}, x_n' = k_f / n sum sin x_j, y = x_1."""
    bound = np.full(n, k_f / n)
    return Polytope(np.eye(n, k=1), np.tile(np.eye(n)[:, -1:], (1, n)), np.eye(n), -bound, bound, np.eye(1, n))


def solved(n, k_f):
    """(|L|, s to find it, s to check it), processor time; with the certificate verified and its gain looked at apart."""
    model, begun = chain(n, k_f), time.process_time()
    gain, certificate = corner_lmi.synthesise(model, rate=RATE, refinements=0)
    found = time.process_time()
    assert isinstance(certificate, Corners)
    assert certificate.verify()
    checked = time.process_time()
    assert certificate.rate == RATE
    np.testing.assert_array_equal(certificate.gain, gain)
    np.testing.assert_array_equal([certificate.lower, certificate.upper], [model.lower, model.upper])
    slope = k_f / n  # every gain that is stable at the frozen corners exceeds slope (1 + slope)^{i-1}
    assert np.all(gain[:, 0] > slope * (1 + slope) ** np.arange(n))
    return float(np.linalg.norm(gain)), found - begun, checked - found


@pytest.mark.parametrize(("n", "k_f"), [(3, 1e4), (5, 1.0), (5, 100.0), (8, 10.0)])
def test_some_chains(n, k_f):
    _, _, check = solved(n, k_f)
    assert check < 5


@pytest.mark.slow
def test_twenty_chains(capsys):
    """n = 10 has 1,024 corners: the check takes about a second."""
    rows = [(n, k_f, *solved(n, k_f)) for n in (3, 5, 8, 10) for k_f in (1.0, 10.0, 100.0, 1e3, 1e4)]
    with capsys.disabled():
        print()
        for n, k_f, size, find, check in rows:
            print(f"n = {n:>2}, k_f = {k_f:<6g}: |L| = {size:.3g}, found in {find:.2f} s, checked in {check:.2f} s")
    assert len(rows) == 20
    assert max(check for *_, check in rows) < 10


def test_lazy_corners_find_what_all_corners_find(monkeypatch):
    """Few of the 32 corners are imposed; the same rate is reached as with all of them."""
    from jaxobs.designs import _frame  # its switch

    model = chain(5, 1.0)
    start = _frame.frame(model)
    lazy = start.solve(start.kappa(-2.0), None)
    assert lazy.margin > 0
    assert 0 < len(start.active) < 32
    monkeypatch.setattr(_frame, "FEW", 64)
    every = _frame.frame(model)
    assert every.solve(every.kappa(-2.0), None).margin == pytest.approx(lazy.margin, rel=1e-3)
    assert every.active == []
