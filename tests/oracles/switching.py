"""Lyapunov questions about a few matrices by other roads: eigenvalues, the Shorten-Narendra criterion, grids."""

import numpy as np
import scipy.linalg


def count(matrix, step, tolerance=1e-7):
    """(inside, border, outside) by LAPACK; borders up to the tolerance."""
    values = np.linalg.eigvals(matrix)
    measure = np.abs(values) - 1 if step else values.real
    return tuple(int(np.sum(part)) for part in (measure < -tolerance, np.abs(measure) <= tolerance, measure > tolerance))


def shorten_narendra(a, b):
    """Two stable 2x2 matrices share a quadratic Lyapunov function iff neither A B nor A B^-1 has a negative real eigenvalue."""

    def has_negative(m):
        values = np.linalg.eigvals(m)
        return bool(np.any((np.abs(values.imag) < 1e-12 * np.abs(values)) & (values.real < 0)))

    return not has_negative(a @ b) and not has_negative(a @ np.linalg.inv(b))


def cayley(f):
    """(F - I)^-1 (F + I): F'P F - P < 0 iff its image is a Lyapunov matrix of the same P."""
    return np.linalg.solve(f - np.eye(len(f)), f + np.eye(len(f)))


def growth(matrices, durations, step):
    """log(spectral radius of the product) / period, the first factor first; per step the root of it."""
    period = np.eye(len(matrices[0]))
    for f, time in zip(matrices, durations, strict=True):
        period = (np.linalg.matrix_power(f, int(time)) if step else scipy.linalg.expm(f * time)) @ period
    radius = np.max(np.abs(np.linalg.eigvals(period)))
    return radius ** (1 / sum(durations)) if step else np.log(radius) / sum(durations)


def best_alternation(matrices, longest=4.0, count=200):
    """The largest growth of two matrices that alternate, over a grid of durations."""
    times = np.arange(1, count + 1) * longest / count
    one, other = ([scipy.linalg.expm(f * t) for t in times] for f in matrices)
    radius = np.max(np.abs(np.linalg.eigvals(np.array(other)[None] @ np.array(one)[:, None])), axis=-1)
    return np.max(np.log(radius) / (times[:, None] + times[None]))


def switched_at_the_axes(damping, low, high):
    """The growth rate of x'' + damping x' + k x = 0, k = high while |x| falls and low while it grows, by quarters of a turn."""
    time, gain = 0.0, 1.0
    for k, falls in ((high, True), (low, False)):
        f = np.array([[0.0, 1.0], [-k, -damping]])
        omega, sigma = np.sqrt(k - damping**2 / 4), damping / 2
        quarter = np.arctan(omega / sigma) / omega  # from x = 0 to x' = 0
        quarter = np.pi / omega - quarter if falls else quarter
        gain *= np.linalg.norm(scipy.linalg.expm(f * quarter) @ ([1.0, 0.0] if falls else [0.0, -1.0]))
        time += quarter
    return np.log(gain) / time
