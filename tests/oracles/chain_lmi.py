"""Chains with bounded slopes by other means: exact checks by python-flint determinants, Lyapunov equations, closed forms."""

import itertools
from fractions import Fraction

import flint
import numpy as np
import scipy.linalg
import scipy.optimize

from oracles.certificate import positive, rational


def matrix(rows):
    return flint.fmpq_mat(len(rows), len(rows[0]), [rational(x) for row in rows for x in row])


def entries(m):
    return [[m[i, j] for j in range(m.ncols())] for i in range(m.nrows())]


def is_positive(m):
    symmetric = all(m[i, j] == m[j, i] for i in range(m.nrows()) for j in range(i))
    return symmetric and positive(entries(m))


def identity(n, scale):
    return flint.fmpq_mat(n, n, [scale if i == j else flint.fmpq(0) for i in range(n) for j in range(n)])


def box(lower, upper, j0, sigma):
    """Rows psi of the corners: psi_i / sigma^{n+1-i} for i > n - j0."""
    n, s = len(lower), rational(sigma)
    ends = [sorted({lo, hi}) for lo, hi in zip(lower, upper, strict=True)]
    for corner in itertools.product(*ends[n - j0 :]):
        row = [flint.fmpq(0)] * n
        for i, value in zip(range(n - j0 + 1, n + 1), corner, strict=True):
            row[i - 1] = rational(value) / s ** (n + 1 - i)
        yield row


def closed(k, row):
    """A + B psi' - K C."""
    n = len(row)
    f = flint.fmpq_mat(n, n)
    for i in range(n - 1):
        f[i, i + 1] = flint.fmpq(1)
    for j in range(n):
        f[n - 1, j] = f[n - 1, j] + row[j]
    for i in range(n):
        f[i, 0] = f[i, 0] - k[i]
    return f


def enough(c):
    """The stored constant is one for these slopes at this theta."""
    last, t = len(c.lower) - c.j0, rational(c.theta)
    total = flint.fmpq(0)
    for i in range(1, last + 1):
        m = max(abs(rational(c.lower[i - 1])), abs(rational(c.upper[i - 1])))
        total += (m / t ** (last - i)) ** 2
    return rational(c.constant) ** 2 >= total


def holds(c, corners):
    """(31)-(32) for a certificate, at the corners given as rows."""
    n, t, lam, nu = len(c.lower), rational(c.theta), rational(c.lam), rational(c.nu)
    if not (t >= 1 and lam > 0 and nu > 0 and c.constant >= 0 and enough(c)):
        return False
    p = matrix(c.p)
    k = [rational(x) / t ** (i + 1) for i, x in enumerate(c.gain)]
    if not (is_positive(p) and is_positive(identity(n, nu) - p)):
        return False
    for row in corners:
        f = closed(k, row)
        if not is_positive(-(f.transpose() * p + p * f) - identity(n, lam)):
            return False
    return t ** (1 + c.j0) * lam > 2 * rational(c.constant) * nu


def holds_hg_lmi(c):
    last = [*zip(c.lower, c.upper, strict=True)][len(c.lower) - c.j0 :]
    if not (0 < c.sigma <= c.theta and all(lo <= 0 <= hi for lo, hi in last)):
        return False
    return holds(c, box(c.lower, c.upper, c.j0, c.sigma))


def refutes(c):
    """The multipliers of a `NoHighGainLmi`: dual feasible, and too small a bound on lam."""
    if not (c.theta >= 1 and c.constant >= 0):
        return False
    n, any_gain = len(c.lower), not c.gain
    k = [flint.fmpq(0)] * n if any_gain else [rational(x) for x in c.gain]
    total, mass = flint.fmpq_mat(n, n), flint.fmpq(0)
    rows = list(box(c.lower, c.upper, c.j0, c.theta))
    if len(c.multipliers) != n * len(rows) or not all(lo <= 0 <= hi for lo, hi in zip(c.lower, c.upper, strict=True)):
        return False
    for place, row in enumerate(rows):
        x = matrix(c.multipliers[place * n : (place + 1) * n])
        inner = [[x[i, j] for j in range(int(any_gain), n)] for i in range(int(any_gain), n)]
        symmetric = all(x[i, j] == x[j, i] for i in range(n) for j in range(i))
        if not (symmetric and positive(inner)) or (any_gain and any(x[i, 0] != 0 for i in range(n))):
            return False
        f = closed(k, row)
        total = total + f * x + x * f.transpose()
        mass += sum((x[i, i] for i in range(n)), flint.fmpq(0))
    w = matrix(c.w)
    zero = all(w[i, j] == 0 for i in range(n) for j in range(n))
    if not ((zero or is_positive(w)) and is_positive(w + total)):
        return False
    trace = sum((w[i, i] for i in range(n)), flint.fmpq(0))
    return rational(c.theta) ** (1 + c.j0) * trace <= 2 * rational(c.constant) * mass


def one_corner_theta(k, row, constant, j0, sigma=1.0):
    """theta for one matrix F = A + B psi' - K C: the least lambda_max(P) with F'P + P F = -I, by its Lyapunov equation."""
    n = len(k)
    f = np.eye(n, k=1)
    f[-1] += row
    f[:, 0] -= k
    p = scipy.linalg.solve_continuous_lyapunov(f.T, -np.eye(n))
    return max(sigma, (2 * constant * np.linalg.eigvalsh(p)[-1]) ** (1 / (1 + j0)))


def smallest_theta_in_the_plane(m1, m2, j0):
    """n = 2, any K: max <M, P> over 0 <= P <= I is the sum of the positive eigenvalues of M, here sqrt(1 + s^2) - s with
    s = m_2/theta at j0 = 1, and 1 at j0 = 0."""

    def excess(theta):
        if j0 == 0:
            return theta - 2 * np.sqrt(m2**2 + (m1 / theta) ** 2)
        s = m2 / theta
        return theta**2 * (np.sqrt(1 + s**2) - s) - 2 * m1

    return 1.0 if excess(1.0) > 0 else scipy.optimize.brentq(excess, 1.0, 1e6, xtol=1e-13, rtol=1e-14)


def is_hurwitz(k):
    """Whether s^n + k_1 s^{n-1} + ... + k_n is Hurwitz, by Routh's array in rational arithmetic."""
    c = [Fraction(1), *(Fraction(x) for x in k)]
    odd, even = c[1::2], c[0::2]
    odd += [Fraction(0)] * (len(even) - len(odd))
    above, row = even, odd
    for _ in k:
        if above[0] <= 0 or row[0] <= 0:
            return False
        below = [a - above[0] / row[0] * b for a, b in zip(above[1:], row[1:], strict=True)] + [Fraction(0)]
        if not any(below):
            break
        above, row = row, below
    return row[0] > 0
