"""Guaranteed levels by hand: Riccati without uncertainty, Lyapunov equations and frequency responses at constant rho.

Nothing here knows how jaxobs covers a box: inequalities are evaluated at many rho, inside as well as at the corners.
"""

import itertools

import numpy as np
import scipy.linalg


def points(lower, upper, count, seed=0):
    """Random rho of the box, and its corners."""
    inside = np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))
    return np.concatenate([inside, np.array(list(itertools.product(*zip(lower, upper, strict=True)))).reshape(-1, len(lower))])


def closed(certificate, rho):
    """(F(rho), [process, -G(rho) noise]) of a certificate."""
    a, b, c, output, gain = (np.array(getattr(certificate, name)) for name in ("a", "b", "c", "output", "gain"))
    inner = np.array(certificate.inner) if certificate.inner else np.zeros((len(rho), len(output)))
    f = a + b @ np.diag(rho) @ (c - inner @ output) - gain @ output
    if not hasattr(certificate, "noise"):
        return f, None
    return f, np.concatenate(
        [np.array(certificate.process), -(gain + b @ np.diag(rho) @ inner) @ np.array(certificate.noise)], 1
    )


def worst(certificate, count=50):
    """The largest eigenvalue, over many rho, of what shall be negative: (rate, level), relative to P and Q."""
    p, rate = np.array(certificate.p), certificate.rate
    found = [-np.inf, -np.inf]
    for rho in points(certificate.lower, certificate.upper, count):
        f, side = closed(certificate, rho)
        found[0] = max(found[0], relative(p @ f + f.T @ p + 2 * rate * p, p))
        if side is None:
            continue
        e = np.array(certificate.weight)
        if getattr(certificate, "x", ()):
            x = np.array(certificate.x)
            found[1] = max(found[1], relative(f @ x + x @ f.T + side @ side.T, x))
        elif certificate.theorem == "h2":
            q = np.array(certificate.q)
            found[1] = max(found[1], relative(q @ f + f.T @ q + e.T @ e, q))
        else:
            q = np.array(certificate.q)
            gained = q @ f + f.T @ q + e.T @ e + q @ side @ side.T @ q / certificate.level**2
            found[1] = max(found[1], relative(gained, q))
    return found


def relative(m, p):
    """The largest eigenvalue of m in coordinates in which p is the identity."""
    scale = 1 / np.sqrt(np.diagonal(p))
    return scipy.linalg.eigh(m * np.outer(scale, scale), p * np.outer(scale, scale), eigvals_only=True)[-1]


def level(certificate):
    """What q or x says of the level, for "h2"."""
    e = np.array(certificate.weight)
    if getattr(certificate, "x", ()):
        return np.trace(e @ np.array(certificate.x) @ e.T)
    side = closed(certificate, np.zeros(len(certificate.lower)))[1]
    return np.trace(side.T @ np.array(certificate.q) @ side)


def frozen(certificate, count=20):
    """The largest E|E e|^2 over constant rho: F S + S F' + side side' = 0."""
    found = []
    e = np.array(certificate.weight)
    for rho in points(certificate.lower, certificate.upper, count):
        f, side = closed(certificate, rho)
        found.append(np.trace(e @ scipy.linalg.solve_continuous_lyapunov(f, -side @ side.T) @ e.T))
    return max(found)


def peak_gain(certificate):
    """The largest singular value of E (i w I - F)^-1 side over frequencies and rho."""
    e, n = np.array(certificate.weight), len(certificate.a)
    found = []
    for rho in points(certificate.lower, certificate.upper, 3):
        f, side = closed(certificate, rho)
        for omega in (0.0, *np.geomspace(1e-3, 1e3, 200)):
            found.append(np.linalg.norm(e @ np.linalg.solve(1j * omega * np.eye(n) - f, side), 2))
    return max(found)


def kalman(a, c, process, noise, weight):
    """tr(E S E') of the steady Kalman-Bucy filter."""
    s = scipy.linalg.solve_continuous_are(a.T, c.T, process @ process.T, noise @ noise.T)
    return np.trace(weight @ s @ weight.T)
