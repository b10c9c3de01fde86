"""One multiplier: the largest smallest eigenvalue of F_0 + tau F_1 over tau > 0."""

import numpy as np


def best_multiplier(f0: np.ndarray, f1: np.ndarray, *, enough: float = np.inf) -> tuple[float, float]:
    """(tau, lambda_min(F_0 + tau F_1)), the latter as large as possible over tau > 0, or any above `enough`.

    The smallest eigenvalue is concave in tau with the supergradient v'F_1 v, v its eigenvector: its sign halves the interval.
    """
    low, high, best = -40.0, 40.0, (1.0, -np.inf)
    for _ in range(90):
        tau = float(np.exp((low + high) / 2))
        values, vectors = np.linalg.eigh(f0 + tau * f1)
        if values[0] > best[1]:
            best = tau, float(values[0])
        if best[1] > enough:
            break
        rising = vectors[:, 0] @ f1 @ vectors[:, 0] > 0
        low, high = ((low + high) / 2, high) if rising else (low, (low + high) / 2)
    return best
