"""A floor on the noise of every observer: just below the Kalman filter's covariance at one value of the parameters."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractModel
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class KalmanFloor(AbstractModel):
    """For e' = (A - L C) e + W w - L V v, A = a + sum_k rho_k b_k c_k' at the constant rho, w and v white of unit intensity,

        [A S + S A' + W W', S C'; C S, V V'] > 0,   V V' > 0,   tr(E S E') >= level,

    S symmetric, no linear filter of y = C x + V v whose bias vanishes from every initial state has a mean of |E e|^2 over time
    below level. Proof: with L = X C'(V V')^-1, the Kalman filter's covariance X of a random x(0) has dX/dt = (A - L C) X + X
    (A - L C)' + W W' + L V V'L', of which S in place of X makes at least the Riccati inequality's left side > 0; so X >= S for
    all times if it is at first. No linear filter has less than X, and a vanishing bias does not count in the mean.

    For Gaussian noise no causal filter at all does better. An observer for all parameters in the box is one for this rho. S
    need not be >= 0.

    a (n, n), b (n, r), c (r, n), output C (p, n), lower <= rho <= upper (r,), weight E (s, n), process W (n, m),
    noise V (p, k), s = S (n, n). Source: Kalman and Bucy, J. Basic Engineering 83 (1961) 95-108; Willems, IEEE Trans. Automatic
    Control 16 (1971) 621-634 (the inequality).
    """

    rho: tuple[float, ...]
    weight: FloatMatrix
    process: FloatMatrix
    noise: FloatMatrix
    s: FloatMatrix
    level: float
    theorem: ClassVar[str] = "kalman-floor"
