"""The least noise at one constant rho among all gains whose error decays there at a required rate: found, not proved."""

import functools

import numpy as np
import scipy.linalg
import scipy.optimize

from jaxobs.bench.measures import noise_at
from jaxobs.designs.polytope import Polytope

STARTS = (0.6, 1.2)  # in units of the fastest of the rate and the modes of the plant


def frozen_optimum(
    model: Polytope, rho: np.ndarray, rate: float, weight: np.ndarray, process: np.ndarray, noise: np.ndarray
) -> float:
    """min_L E |E e|^2 at the constant rho (r,):   A(rho) - L C has all eigenvalues at Re s <= -rate   (one output).

    The poles are the unknowns, -rate plus the roots of factors s^2 + a s + b and s + b with a, b >= 0; L follows from them
    (Ackermann). Quasi-Newton from a few starts: a bound from neither side, but what a proof for the whole box is measured by.
    """
    a, c = model.at(rho), model.output
    n = model.n
    speed = max(rate, float(np.max(np.abs(np.linalg.eigvals(a)))), 1e-3)
    last = np.linalg.solve(np.vstack([c @ np.linalg.matrix_power(a, k) for k in range(n)]), np.eye(n)[:, -1:])

    def gain(x: np.ndarray) -> np.ndarray:
        """From the square roots of a and b, in units of the speed."""
        factors = [np.array([1.0, (speed * u**2), (speed * v) ** 2]) for u, v in x[: n - n % 2].reshape(-1, 2)]
        if n % 2:
            factors.append(np.array([1.0, speed * x[-1] ** 2]))
        polynomial = functools.reduce(np.polymul, factors)
        shifted = a + rate * np.eye(n)  # its eigenvalues are those of A, moved to the right by the rate
        return functools.reduce(lambda p, q: p @ shifted + q * np.eye(n), polynomial, np.zeros((n, n))) @ last

    def cost(x: np.ndarray) -> float:
        x_cov = noise_at(model, gain(x), rho, process, noise)
        return 1e3 if x_cov is None else float(np.log(np.trace(weight @ x_cov @ weight.T)))

    starts = [np.full(n, s) for s in STARTS]
    x = scipy.linalg.solve_continuous_are(a.T, c.T, process @ process.T, noise @ noise.T)
    kalman = np.linalg.eigvals(a - x @ c.T @ np.linalg.solve(noise @ noise.T, c)) + rate  # its poles, where they may stay
    kalman = np.minimum(kalman.real, -1e-3 * speed) + 1j * kalman.imag
    starts.append(_unknowns(kalman, speed))
    return float(np.exp(min(scipy.optimize.minimize(cost, x, method="BFGS").fun for x in starts)))


def _unknowns(poles: np.ndarray, speed: float) -> np.ndarray:
    """The unknowns of `frozen_optimum` that give these poles, all at Re s < 0: real ones are paired in order."""
    real = sorted(p.real for p in poles if p.imag == 0)
    pairs = [(-2 * p.real, abs(p) ** 2) for p in poles if p.imag > 0]
    pairs += [(-p - q, p * q) for p, q in zip(real[0::2], real[1::2], strict=False)]
    last = [np.sqrt(-real[-1] / speed)] if len(poles) % 2 else []
    return np.array([x for a, b in pairs for x in (np.sqrt(a / speed), np.sqrt(b) / speed)] + last)
