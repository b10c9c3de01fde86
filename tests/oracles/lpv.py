"""Error dynamics between bounds, without jaxobs: right-hand sides, slopes, rank tests, plain NumPy, SciPy and fractions."""

from fractions import Fraction

import numpy as np
import scipy.integrate


def duffing(x, u=0.0):
    return np.array([x[1], u - 0.1 * x[1] - x[0] ** 3])


def joint(x, u=0.0):
    d = x[2] - x[0]
    tau = d + d**3
    motor, link = 3.7e-3, 9.3e-3
    weight = 0.21 * 9.81 * 0.15
    return np.array([x[1], (tau - 4.6e-2 * x[1] + 8e-2 * u) / motor, x[3], -(tau + weight * np.sin(x[2])) / link])


def lorenz(x):
    return np.array([10 * (x[1] - x[0]), 28 * x[0] - x[1] - x[0] * x[2], x[0] * x[1] - 8 / 3 * x[2]])


def lorenz_step(x, t=0.001):
    return x + t * lorenz(x)


def rossler(x):
    return np.array([-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)])


def van_der_pol(x):
    return np.array([x[1], (1 - x[0] ** 2) * x[1] - x[0]])


def share_quadratic(a, b):
    """Whether two Hurwitz 2x2 matrices (of fractions) have a common quadratic Lyapunov function: neither A B nor A B^-1 has a
    negative real eigenvalue. Source: Shorten and Narendra, Int. J. Adaptive Control and Signal Processing 16 (2002)."""

    def product(x, y):
        return [[sum(x[i][k] * y[k][j] for k in range(2)) for j in range(2)] for i in range(2)]

    def negative_real(m):
        trace, det = m[0][0] + m[1][1], m[0][0] * m[1][1] - m[0][1] * m[1][0]
        if trace**2 - 4 * det < 0:
            return False
        return det < 0 or (det > 0 and trace < 0) or (det == 0 and trace < 0)

    assert all(m[0][0] + m[1][1] < 0 < m[0][0] * m[1][1] - m[0][1] * m[1][0] for m in (a, b))
    adjugate = [[b[1][1], -b[0][1]], [-b[1][0], b[0][0]]]  # b^-1 up to the positive factor 1 / det b
    return not negative_real(product(a, b)) and not negative_real(product(a, adjugate))


def duffing_corner(slope):
    """A(h) - L C of example 1 with the printed L, as fractions."""
    l1, l2, c1 = Fraction(9901, 10000), Fraction(-56, 10000), Fraction(1, 5)
    return [[-l1 * c1, 1 - l1], [-Fraction(slope) - l2 * c1, Fraction(-1, 10) - l2]]


def unobservable_modes(a, c, tolerance=1e-8):
    """Eigenvalues of a with an eigenvector in the kernel of c (PBH, by singular values)."""
    n = len(a)
    return [
        s for s in np.linalg.eigvals(a) if np.linalg.svd(np.vstack([a - s * np.eye(n), c]), compute_uv=False)[-1] < tolerance
    ]


def run(flow, x0, end, points=201, **options):
    """(t, x) of x' = flow(x) by LSODA."""
    ts = np.linspace(0, end, points)
    found = scipy.integrate.solve_ivp(
        lambda t, x: flow(x), (0, end), x0, t_eval=ts, method="LSODA", **{"rtol": 1e-10, "atol": 1e-12} | options
    )
    return found.t, found.y.T
