"""The slopes of a Lipschitz function between two points, one coordinate at a time; it need not be differentiable."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jaxobs._module import refuse


def auxiliary(x: ArrayLike, z: ArrayLike, i: int) -> np.ndarray:
    """X^{Z_i} = (z_1, ..., z_i, x_{i+1}, ..., x_n), i = 0..n: from X^{Z_0} = X to X^{Z_n} = Z (paper 002, (1))."""
    x, z = np.asarray(x), np.asarray(z)
    if x.ndim != 1 or x.shape != z.shape:
        raise refuse(
            "auxiliary", "z", f"shapes {x.shape} and {z.shape}", "two vectors of one length", "X and Z are points of R^n."
        )
    if not 0 <= i <= len(x):
        raise refuse("auxiliary", "i", i, f"an integer from 0 to {len(x)}", "It counts the coordinates taken from Z.")
    return np.concatenate([z[:i], x[i:]])


def slopes(f: Callable[[np.ndarray], Any], x: ArrayLike, z: ArrayLike, bounds: Any = None) -> np.ndarray:
    """psi with f(X) - f(Z) = sum_j psi_j (x_j - z_j), exactly (paper 002, lemmas 1 and 2, (2) and (4)):

        psi_j = (f(X^{Z_{j-1}}) - f(X^{Z_j})) / (x_j - z_j),   and where x_j = z_j the number of the bounds closest to 0.

    x, z (n,); f: (n,) -> a number or (m,); returns (n,) or (m, n). With bounds (n, 2) or (m, n, 2), rows (lowest, highest), a
    slope outside them is a ValueError that names both points: the bounds are refuted. Rational points (fractions.Fraction)
    give rational slopes, without rounding, if f keeps to arithmetic, abs and comparisons.
    """
    x, z = np.asarray(x), np.asarray(z)
    n = len(x)
    values = [np.asarray(f(auxiliary(x, z, i))) for i in range(n + 1)]
    limits = None if bounds is None else _limits(bounds, values[0].shape, n)
    columns = []
    for j in range(n):
        if x[j] != z[j]:
            columns.append((values[j] - values[j + 1]) / (x[j] - z[j]))
        elif limits is None:
            columns.append(0 * values[0])
        else:
            columns.append(np.clip(0.0, limits[..., j, 0], limits[..., j, 1]))
    found = np.stack(columns, axis=-1)
    if limits is not None and np.any(outside := (found < limits[..., 0]) | (found > limits[..., 1])):
        place = tuple(int(i) for i in np.argwhere(outside)[0])
        j = place[-1]
        here = f"psi_{j + 1} = {float(found[place]):.9g} between {auxiliary(x, z, j)} and {auxiliary(x, z, j + 1)}"
        raise refuse("slopes", "bounds", f"{limits[place].tolist()} with {here}", "bounds that hold", "Widen this pair.")
    return found


def _limits(bounds: Any, image: tuple[int, ...], n: int) -> np.ndarray:
    limits = np.asarray(bounds, float)
    if limits.shape != (*image, n, 2):
        fix = "One pair (lowest, highest) for each coordinate."
        raise refuse("slopes", "bounds", f"shape {limits.shape}", f"shape {(*image, n, 2)}", fix)
    if np.any(limits[..., 0] > limits[..., 1]):
        raise refuse("slopes", "bounds", limits.tolist(), "lowest <= highest in every pair", "Swap the two numbers.")
    return limits
