"""Errors of a plant with one nonlinearity, without jaxobs: plain right-hand sides and SciPy's integrator."""

import numpy as np
import scipy.integrate


def cubic(x):
    """x1' = x2, x2' = x2 - x2^3 - x1: the van der Pol oscillator in Rayleigh's form; y = x1."""
    return np.array([x[1], x[1] - x[1] ** 3 - x[0]])


def together(plant, model, gain, x0, xhat0, end, points=400):
    """(t, x, xhat) of x' = plant(t, x), xhat' = model(xhat) + gain (x1 - xhat1)."""
    n = len(x0)

    def flow(t, z):
        return np.concatenate([plant(t, z[:n]), model(z[n:]) + gain * (z[0] - z[n])])

    ts = np.linspace(0, end, points)
    found = scipy.integrate.solve_ivp(flow, (0, end), [*x0, *xhat0], t_eval=ts, rtol=1e-9, atol=1e-12)
    return found.t, found.y[:n].T, found.y[n:].T


def peak_gain(f, b, e, end=40.0, points=20_001):
    """The integral of |e exp(f t) b|: the largest e z for z' = f z + b d, |d| <= 1, from zero (one input, one output)."""
    ts = np.linspace(0, end / np.min(np.abs(np.linalg.eigvals(f).real)), points)
    values, vectors = np.linalg.eig(f)
    left, right = e @ vectors, np.linalg.solve(vectors, b)
    return np.trapezoid(np.abs((left * right * np.exp(np.outer(ts, values))).sum(1).real), ts)
