"""What a derivative tracker does to a signal and to noise, in closed form, and the rate mu that serves best.

All at mu = 1 with N = n + q, in exact integers as long as possible; at other rates every gain scales with a power of mu. With

    Xhat_i / Y = s^{i-1} sum_{j=0}^{n-i} C(N, j) mu^{N-j} s^j / (s + mu)^N          (paper 001, (3)-(4) in steady state)

the error of xhat_i is the filtered noise d, and the part of the signal that is lost, which y^(n) drives:

    E_i / D = Xhat_i / Y,      E_i / Y^(n) = - sum_{j=r}^{N} C(N, j) mu^{N-j} s^{j-r} / (s + mu)^N,      r = n - i + 1.
"""

import dataclasses
import math

import numpy as np
import scipy.optimize
from jaxtyping import Float

from jaxobs._module import refuse, require_integer


def fading_rate(sigma: float, dt: float) -> float:
    """mu = -ln(sigma) / dt [1/s]: the rate of the DiscreteTracker whose poles lie at sigma, for samples dt [s] apart.

    ValueError unless 0 < sigma < 1 and dt > 0. Source: paper 001, (30), with the exact sigma.
    """
    if not 0 < sigma < 1:
        fix = "It is how much of a sample is remembered at the next one: near 1 is slow and quiet, near 0 fast and noisy."
        raise refuse("fading_rate", "sigma", sigma, "a number in ]0, 1[", fix)
    if not (math.isfinite(dt) and dt > 0):
        raise refuse("fading_rate", "dt", dt, "a positive number", "It is the sampling period in seconds.")
    return -math.log(sigma) / dt


def transfer(n: int, q: int, i: int) -> list[int]:
    """The numerator of Xhat_i / Y at mu = 1: s^{i-1} sum_{j=0}^{n-i} C(N, j) s^j, over (s + 1)^N, N = n + q.

    Its n integer coefficients, constant term first. At other rates s is counted in mu, and the whole is times mu^{i-1}.
    ValueError unless n >= 1, q >= 0, 1 <= i <= n are integers. Source: paper 001, (3)-(4) in steady state.
    """
    size = _size(n, q, i)
    return [0] * (i - 1) + [math.comb(size, j) for j in range(n - i + 1)]


def lost(n: int, q: int, i: int) -> list[int]:
    """The numerator of E_i / Y^(n) at mu = 1: -sum_{j=r}^{N} C(N, j) s^{j-r}, over (s + 1)^N, N = n + q, r = n - i + 1.

    Its q + i integer coefficients, constant term first. At other rates s is counted in mu, and the whole is times mu^{-r}.
    Errors and source as for `transfer`.
    """
    size = _size(n, q, i)
    return [-math.comb(size, j) for j in range(n - i + 1, size + 1)]


def response(n: int, q: int, i: int, omega: Float[np.ndarray, "*w"]) -> Float[np.ndarray, "*w"]:
    """|Xhat_i / Y| at the frequencies omega, counted in mu; times mu^{i-1} in the units of y^(i-1). The gain of a tone."""
    s = 1j * np.asarray(omega, float)
    return np.asarray(np.abs(np.polyval(transfer(n, q, i)[::-1], s) / (1 + s) ** (n + q)))


@dataclasses.dataclass(frozen=True)
class TrackerGains:
    """The gains to the estimates xhat_1, ..., xhat_n of one tracker, each (n,), at mu = 1; r_i = n - i + 1.

    bias: |error| under a constant y^(n) = 1: C(N, r), times mu^{-r}. worst_bias: the largest |error| under |y^(n)| <= 1 (L1
    norm), times mu^{-r}. white: rms error under white noise of unit intensity (H2 norm), times mu^{i-1/2}; samples of standard
    deviation sigma held over T_s << 1/mu have the intensity sigma^2 T_s. worst: the largest |error| under |d| <= 1 (L1 norm),
    times mu^{i-1}. bandwidth: the largest omega / mu at which |Xhat_i / Y| is 1/sqrt(2) of the ideal omega^{i-1}.
    """

    n: int
    q: int
    bias: tuple[float, ...]
    worst_bias: tuple[float, ...]
    white: tuple[float, ...]
    worst: tuple[float, ...]
    bandwidth: tuple[float, ...]


def tracker_gains(n: int, q: int) -> TrackerGains:
    """All gains of the tracker with n estimates and q integrators at mu = 1, i = 1..n:

        bias C(N, r),   worst_bias int |g_i| dt,   white sqrt(int h_i^2 dt),   worst int |h_i| dt,   r = n - i + 1,

    and the bandwidth; h_i, g_i: the impulse responses of Xhat_i / Y and E_i / Y^(n). Units, powers of mu: see `TrackerGains`.
    ValueError unless n >= 1 and q >= 0 are integers. Source: paper 001, (3)-(4) in steady state; L1 and H2 norms: Boyd and
    Barratt, Linear Controller Design, 1991, chapter 5.
    """
    order = range(1, n + 1)
    size = _size(n, q, 1)
    return TrackerGains(
        n,
        q,
        bias=tuple(float(math.comb(size, n - i + 1)) for i in order),
        worst_bias=tuple(_l1(lost(n, q, i), size) for i in order),
        white=tuple(_h2(transfer(n, q, i), size) for i in order),
        worst=tuple(_l1(transfer(n, q, i), size) for i in order),
        bandwidth=tuple(_bandwidth(n, q, i) for i in order),
    )


def equal_bias(n: int, q: int, i: int) -> float:
    """mu_q / mu_0 at which xhat_i has the bias that it has without integrators: [C(N, r) / C(n, r)]^{1/r}, r = n - i + 1.

    A number without unit; equal bias under a constant y^(n), C(N, r) mu_q^{-r} = C(n, r) mu_0^{-r}. Errors as for `transfer`.
    """
    r = n - i + 1
    return (math.comb(_size(n, q, i), r) / math.comb(n, r)) ** (1 / r)


def equal_bandwidth(n: int, q: int, i: int) -> float:
    """mu_q / mu_0 at which xhat_i has the bandwidth that it has without integrators: w_i(0) / w_i(q), w_i that of TrackerGains.

    A number without unit: mu_q w_i(q) = mu_0 w_i(0). Errors as for `transfer`.
    """
    return _bandwidth(n, 0, i) / _bandwidth(n, q, i)


def relative_white(n: int, q: int, i: int, ratio: float = 1.0) -> float:
    """rms error of xhat_i under white noise with q integrators at mu = ratio mu_0, over that with none at mu_0:

        white_i(q) / white_i(0) ratio^{i-1/2},      white_i that of TrackerGains, ratio > 0.

    Without unit. Errors as for `transfer`.
    """
    size = _size(n, q, i)
    return _h2(transfer(n, q, i), size) / _h2(transfer(n, 0, i), n) * ratio ** (i - 0.5)


def relative_tone(n: int, q: int, i: int, omega: float, ratio: float = 1.0) -> float:
    """Amplitude of a tone of frequency omega mu_0 in xhat_i, q integrators at ratio mu_0, over that with none at mu_0:

        |H_{i,q}(j omega / ratio)| / |H_{i,0}(j omega)| ratio^{i-1},      H = Xhat_i / Y at mu = 1, omega > 0, ratio > 0.

    omega: one number, in units of mu_0. Without unit. Errors as for `transfer`.
    """
    return float(response(n, q, i, np.asarray(omega / ratio)) / response(n, 0, i, np.asarray(omega))) * ratio ** (i - 1)


@dataclasses.dataclass(frozen=True)
class BestRate:
    """mu [1/s] and the two parts of the error of xhat_i at it: from the signal's own y^(n), and from the noise."""

    mu: float
    bias: float
    noise: float


def best_rate(
    n: int, q: int, i: int, *, derivative: float, bound: float | None = None, intensity: float | None = None
) -> BestRate:
    """The rate that balances bias against noise in xhat_i, i >= 2 under bounded noise, in closed form; |y^(n)| <= derivative.

    bound, |d| <= bound: minimises the guaranteed |error| a mu^{-r} + b mu^{i-1}, so mu^n = r a / ((i - 1) b);
    intensity, white noise: minimises a^2 mu^{-2r} + c^2 mu^{2i-1}, so mu^{2n+1} = 2 r a^2 / ((2 i - 1) c^2);
    a = worst_bias derivative, b = worst bound, c = white sqrt(intensity). Exactly one of the two is given, in units of y, and
    of y^2 s. ValueError otherwise, and for bounded noise with i = 1: its gain does not depend on mu, larger is better.
    """
    size, r = _size(n, q, i), n - i + 1
    for name, value in (("derivative", derivative), ("bound", bound), ("intensity", intensity)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise refuse("best_rate", name, value, "a positive number", "It bounds what the tracker has to cope with.")
    if (bound is None) == (intensity is None):
        raise refuse(
            "best_rate", "bound", f"bound {bound} and intensity {intensity}", "one of them", "Say of which kind the noise is."
        )
    a = _l1(lost(n, q, i), size) * derivative
    if bound is not None:
        if i == 1:
            fix = "Choose mu from the bias alone, or give the intensity of white noise."
            raise refuse("best_rate", "i", 1, "i >= 2 for bounded noise", fix)
        b = _l1(transfer(n, q, i), size) * bound
        mu = (r * a / ((i - 1) * b)) ** (1 / n)
        return BestRate(mu, a / mu**r, b * mu ** (i - 1))
    assert intensity is not None
    c = _h2(transfer(n, q, i), size) * math.sqrt(intensity)
    mu = (2 * r * a**2 / ((2 * i - 1) * c**2)) ** (1 / (2 * n + 1))
    return BestRate(mu, a / mu**r, c * mu ** (i - 0.5))


def _size(n: int, q: int, i: int) -> int:
    require_integer("tracker", "n", n, 1, "It counts the signal and the derivatives wanted: order + 1.")
    require_integer("tracker", "q", q, 0, "It counts the integrators in front of the estimate.")
    require_integer("tracker", "i", i, 1, "xhat_i estimates y^(i-1).")
    if i > n:
        raise refuse("tracker", "i", i, f"at most n = {n}", "xhat_i estimates y^(i-1).")
    return n + q


def _impulse(numerator: list[int], size: int) -> list[float]:
    """c, where e^{-t} sum_k c_k t^k is the impulse response of numerator / (s + 1)^size: expand it in powers of s + 1."""
    about = [
        sum(a * math.comb(j, k) * (-1) ** (j - k) for j, a in enumerate(numerator) if j >= k) for k in range(len(numerator))
    ]
    taylor = [0.0] * size
    for k, a in enumerate(about):
        taylor[size - k - 1] = a / math.factorial(size - k - 1)
    return taylor


def _h2(numerator: list[int], size: int) -> float:
    """sqrt(int_0^inf e^{-2t} p(t)^2 dt)."""
    p = _impulse(numerator, size)
    return math.sqrt(
        math.fsum(a * b * math.factorial(j + k) / 2 ** (j + k + 1) for j, a in enumerate(p) for k, b in enumerate(p))
    )


def _l1(numerator: list[int], size: int) -> float:
    """int_0^inf |e^{-t} p(t)| dt: the primitive -e^{-t} (p + p' + p'' + ...) taken between the zeros of p."""
    p = np.polynomial.Polynomial(_impulse(numerator, size))
    primitive = sum((p.deriv(k) for k in range(1, size)), start=p)
    zeros = np.sort([z.real for z in p.roots() if abs(z.imag) < 1e-9 * abs(z) and z.real > 0])
    values = [primitive(0.0), *(math.exp(-z) * primitive(z) for z in zeros), 0.0]
    return float(np.sum(np.abs(np.diff(values))))


def _bandwidth(n: int, q: int, i: int) -> float:
    def below(log_omega: float) -> float:
        omega = math.exp(log_omega)
        return math.log(float(response(n, q, i, np.asarray(omega)))) - (i - 1) * log_omega + math.log(2) / 2

    high = 3.0
    while below(high - 0.1) < 0:  # from above, down to the last crossing
        high -= 0.1
    root = scipy.optimize.brentq(below, high - 0.1, high, xtol=1e-13)
    return math.exp(float(root))  # pyright: ignore[reportArgumentType]: without full_output it is a float
