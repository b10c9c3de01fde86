"""A floor on the noise of every observer: just below the Kalman filter's covariance at one value of the parameters."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates.base import AbstractCertificate, FloatMatrix


@dataclasses.dataclass(frozen=True)
class KalmanFloor(AbstractCertificate):
    """For e' = (A - L C) e + W w - L V v, A = a + sum_k rho_k b_k c_k' at the constant rho, w and v white of unit intensity,

        [A S + S A' + W W', S C'; C S, V V'] > 0,   V V' > 0,   tr(E S E') >= level,

    every gain L with A - L C Hurwitz has E |E e|^2 >= level in the mean over time: the left side is at least
    (A - L C) S + S (A - L C)' + W W' + L V V'L' > 0, and the covariance X makes that zero, so that X - S > 0 (Lyapunov).

    The Kalman filter is of this form, hence no causal unbiased filter of y = C x + V v does better, and for Gaussian noise no
    causal one at all. An observer for all parameters in the box is one for this rho. S need not be >= 0.

    a (n, n), b (n, r), c (r, n), output C (p, n), lower <= rho <= upper (r,), weight E (s, n), process W (n, m),
    noise V (p, k), s = S (n, n). Source: Kalman and Bucy, J. Basic Engineering 83 (1961) 95-108; Willems, IEEE Trans. Automatic
    Control 16 (1971) 621-634 (the inequality).
    """

    a: FloatMatrix
    b: FloatMatrix
    c: FloatMatrix
    output: FloatMatrix
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    rho: tuple[float, ...]
    weight: FloatMatrix
    process: FloatMatrix
    noise: FloatMatrix
    s: FloatMatrix
    level: float
    tied: tuple[int, ...] = ()
    theorem: ClassVar[str] = "kalman-floor"
