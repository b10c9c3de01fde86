"""Errors of observers with held innovation, by matrix exponentials; and Wirtinger's constant at a rate, by root finding."""

import numpy as np
import scipy.linalg
import scipy.optimize


def over(a, injected, tau):
    """(e, q)(tau) from (e, q)(0), q held: e' = a e - injected q."""
    n, p = injected.shape
    return scipy.linalg.expm(tau * np.block([[a, -injected], [np.zeros((p, n + p))]]))


def monodromy(a, gain, output, delta):
    """e(delta) = Phi e(0) of e' = a e - gain output e(0)."""
    n = len(a)
    whole = over(a, gain, delta)
    return whole[:n, :n] + whole[:n, n:] @ output


def limit(matrices, gain, output, high=1.0):
    """The period from which on one of the constant matrices gives an unstable error, by bisection from a stable start."""

    def stable(delta):
        return max(np.max(np.abs(np.linalg.eigvals(monodromy(a, gain, output, delta)))) for a in matrices) < 1

    return bisected(stable, high)


def euler_limit(matrices, gain, output, high=1.0):
    """The same of e+ = (I + delta (a - gain output)) e."""

    def stable(delta):
        n = len(gain)
        return max(np.max(np.abs(np.linalg.eigvals(np.eye(n) + delta * (a - gain @ output)))) for a in matrices) < 1

    return bisected(stable, high)


def bisected(stable, high):
    low = 0.0
    for _ in range(24):
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def walk(model, gain, delta, pieces, samples, rng, inner=None):
    """e at the ends of short pieces of random constant parameters, over random intervals up to delta, (times, errors, ages).

    inner (r, p): of the innovation that the channels see."""
    inner = np.zeros((model.r, model.p)) if inner is None else inner
    e, now = rng.normal(size=model.n), 0.0
    times, errors, since = [0.0], [e], [0.0]
    for _ in range(samples):
        interval = delta * rng.choice([1.0, rng.uniform(0.05, 1.0)])
        state = np.concatenate([e, model.output @ e])
        for k in range(pieces):
            rho = rng.choice([model.lower, model.upper, rng.uniform(model.lower, model.upper)])
            state = over(model.at(rho), gain + (model.b * rho) @ inner, interval / pieces) @ state
            times.append(now + (k + 1) * interval / pieces)
            errors.append(state[: model.n])
            since.append((k + 1) * interval / pieces)
        e, now = state[: model.n], now + interval
    return np.array(times), np.array(errors), np.array(since)


def wirtinger(x):
    """sup (m^2 + x^2) with m cot m = x, 0 <= x < 1, in units of the period: kappa by root finding."""
    m = np.pi / 2 if x == 0 else scipy.optimize.brentq(lambda m: m * np.cos(m) / np.sin(m) - x, 1e-9, np.pi / 2)
    return m**2 + x**2
