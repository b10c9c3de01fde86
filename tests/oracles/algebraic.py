"""Paper 001, section 4, by other means: root finding, sympy, scipy.signal; nothing of jaxobs."""

import numpy as np
import scipy.integrate
import scipy.linalg
import scipy.signal
import sympy


def duffing_root(y, dy, a=1.0, b=1.0):
    """x1 with b x1^3 + (1 + a) x1 = y - dy: the real root that numpy finds."""
    roots = np.roots([b, 0.0, 1 + a, dy - y])
    return float(roots[np.argmin(np.abs(roots.imag))].real)


def duffing_jet(x1, x2, order, a=1, b=1):
    """(y, y', ...) of y = x1 + x2, x1' = x2, x2' = -a x1 - b x1^3, by sympy."""
    p, q = sympy.symbols("p q")
    flow, last, out = {p: q, q: -a * p - b * p**3}, p + q, []
    for _ in range(order + 1):
        out.append(last.subs({p: x1, q: x2}))
        last = sum(sympy.diff(last, v) * f for v, f in flow.items())
    return out


def structure(n, q):
    size = n + q
    a = np.eye(size, k=1)
    if q:
        a[q - 1, q] = -1.0
    b = np.zeros(size)
    if q:
        b[q - 1] = 1.0
    return a, b


def h_infinity(n, q, mu):
    """The solution of -mu H - A'H - H A + C'C = 0 by a Lyapunov solver."""
    a, _ = structure(n, q)
    c = np.eye(1, n + q)
    return scipy.linalg.solve_continuous_lyapunov(-(a.T + mu / 2 * np.eye(n + q)), -c.T @ c)


def filter_of(n, q, i, mu=1.0):
    """Xhat_i / Y as a scipy system, from the state-space form and the Lyapunov solver."""
    a, b = structure(n, q)
    gain = np.linalg.solve(h_infinity(n, q, mu), np.eye(n + q)[0])
    closed = a - np.outer(gain, np.eye(n + q)[0])
    b = b if q else gain
    return scipy.signal.StateSpace(closed, b[:, None], np.eye(n + q)[[q + i - 1]], np.zeros((1, 1)))


def lost_of(n, q, i):
    """E_i / Y^(n), mu = 1: the error's own system with -B as input, (10)."""
    a, _ = structure(n, q)
    gain = np.linalg.solve(h_infinity(n, q, 1.0), np.eye(n + q)[0])
    closed = a - np.outer(gain, np.eye(n + q)[0])
    return scipy.signal.StateSpace(closed, -np.eye(n + q)[:, [-1]], np.eye(n + q)[[q + i - 1]], np.zeros((1, 1)))


def impulse(system, end=60.0, count=24001):
    t = np.linspace(0, end, count)
    return t, scipy.signal.impulse(system, T=t)[1]


def l1(system):
    t, g = impulse(system)
    return scipy.integrate.simpson(np.abs(g), x=t)


def h2(system):
    """sqrt(C X C') of the Lyapunov equation."""
    x = scipy.linalg.solve_continuous_lyapunov(system.A, -system.B @ system.B.T)
    return float(np.sqrt((system.C @ x @ system.C.T)[0, 0]))


def magnitude(system, omega):
    size = system.A.shape[0]
    return np.asarray(
        [np.abs(system.C @ np.linalg.solve(1j * w * np.eye(size) - system.A, system.B))[0, 0] for w in np.atleast_1d(omega)]
    )


def transition(n, q, mu, start, t):
    """Phi(t) of (24), eta and H integrated together."""
    a, _ = structure(n, q)
    size, c = n + q, np.eye(1, n + q)

    def rate(_, v):
        h, phi = v[: size * size].reshape(size, size), v[size * size :].reshape(size, size)
        dh = -mu * h - a.T @ h - h @ a + c.T @ c
        dphi = a @ phi - np.outer(np.linalg.solve(h, c[0]), phi[0])
        return np.concatenate([dh.ravel(), dphi.ravel()])

    v0 = np.concatenate([np.asarray(start, float).ravel(), np.eye(size).ravel()])
    done = scipy.integrate.solve_ivp(rate, (0, t), v0, method="LSODA", rtol=1e-11, atol=1e-14)
    return done.y[size * size :, -1].reshape(size, size)


def transfer_35_37():
    """[Xhat_i(z) / Y(z)] of (33) with the gain (34), and the printed numerators and denominator, in sympy."""
    z, s, d = sympy.symbols("z sigma delta")
    a = sympy.Matrix(3, 3, lambda i, j: int(j == i + 1))
    f = sympy.eye(3) + a * d + a * a * d**2 / 2
    h = sympy.zeros(3, 3)
    for i in range(3):
        for j in range(3):  # the geometric sums of (32)
            h[i, j] = (-1) ** (i + j) * d ** (i + j + 1) * _sum(i + j, s) / (sympy.factorial(i) * sympy.factorial(j))
    gain = (d * h.inv()[:, 0]).applyfunc(sympy.simplify)
    closed = f - gain * f[0, :]
    whole = (z * sympy.eye(3) - closed).LUsolve(gain).applyfunc(sympy.simplify)
    return z, s, d, gain, whole


def _sum(m, s):
    """sum_k k^m s^k."""
    value = 1 / (1 - s)
    for _ in range(m):
        value = s * sympy.diff(value, s)
    return sympy.simplify(value)
