"""What q integrators buy: "the error becomes smaller and smaller, with a level gamma^{-q/2}", by four measures of equality.

Var e_x2 = sigma^2 T_s gamma^3 c(alphas, q) for broadband noise, phi left out. Ratios refer to the paper's alphas (3, 2), q = 0.
"""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

import math
from functools import lru_cache

import jax
import numpy as np

from jaxobs import hurwitz
from jaxobs._module import as_param
from jaxobs.linalg import noise_covariance
from jaxobs.observers import HighGain, IntegralHighGain
from jaxobs.papers.claims import OURS, Statement
from jaxobs.papers.p000 import experiment
from jaxobs.papers.p000.paper import PAPER
from jaxobs.papers.p000.weights import riccati_pair
from jaxobs.plants import Pendulum
from jaxobs.studies import grid
from jaxobs.tuning import MEASURES, Measure, Quietest, noise_constant, quietest, speed

ORDERS = range(4)
GAMMAS = (4.0, 6.0, 9.0, 12.0)
SEEDS = 64
covariance_of = jax.jit(noise_covariance, static_argnums=1)
SLOW = 1.0  # spread of the measured alphas: every pole stays slower than the noise is held


def binomial(q: int) -> Quietest:
    """C(2 + q, k): at equal gamma alpha has to be given, for any c is reached by slower poles."""
    alphas = np.asarray(hurwitz.binomial(2 + q))
    c = float(noise_constant(alphas, q))
    return Quietest(alphas, c, math.sqrt(c / float(noise_constant(experiment.ALPHAS))))


@lru_cache
def measured_ratios() -> dict[str, np.ndarray]:
    """RMSE of x2 on the pendulum, relative to (3, 2) at the same gamma: {measure: (q, gamma)}, medians over the seeds."""
    plant, names = Pendulum(), ("gamma", *MEASURES)
    reference = experiment.rmse_of_x2(grid(HighGain(plant, experiment.ALPHAS, 1.0), gamma=GAMMAS), SEEDS)
    rows = []
    for q in ORDERS:
        alphas = [binomial(q).alphas, *(quietest(measure, q, spread=SLOW).alphas for measure in MEASURES)]
        family = grid(IntegralHighGain(plant, alphas[0], 1.0, q), alphas=np.stack(alphas), gamma=GAMMAS)
        rows.append(np.median(experiment.rmse_of_x2(family, SEEDS) / reference, axis=2))
    return dict(zip(names, np.stack(rows, axis=1), strict=True))


def _transfer(q: int, gamma: float, frequency: float, state: int = 2) -> float:
    """|xhat_state / y| of the binomial observer at i * frequency, phi left out: minus the noise's part of e' = F e + b w, plus
    x.
    """
    size = 2 + q
    gain = np.asarray(hurwitz.binomial(size)) * gamma ** np.arange(1.0, size + 1)
    flow = np.eye(size, k=1)
    flow[:, 0] -= gain
    enters = gain if q == 0 else np.eye(size)[q - 1]
    return float(abs(np.linalg.solve(1j * frequency * np.eye(size) - flow, enters)[q + state - 1]))


def _listed(values, digits: int = 3) -> str:
    return ", ".join(f"{value:.{digits}g}" for value in values)


@PAPER.claim("(48) level gamma^-q/2", "universal", printed="noise is attenuated like gamma^-q/2", long=True)
def _():
    """Exponents of gamma in the standard deviation of x_2, and of the norm W, from unscaled solutions at gamma and 2 gamma; and
    in the answer of xhat_2 to one tone far above the bandwidth.
    """
    powers, weighted = [], []
    tone = 1e4
    tones = [math.log2(_transfer(q, 8.0, tone) / _transfer(q, 4.0, tone)) for q in ORDERS]
    for q in ORDERS:
        size, alphas, stds, norms = 2 + q, hurwitz.binomial(2 + q), [], []
        for gamma in (4.0, 8.0):
            d = gamma ** np.arange(1.0, size + 1)
            covariance = np.asarray(covariance_of(as_param(np.asarray(alphas) * d), q))
            z, _ = (np.asarray(m) for m in riccati_pair(alphas, as_param(gamma)))
            stds.append(math.sqrt(covariance[q + 1, q + 1]))
            norms.append(math.sqrt(np.trace(np.linalg.solve(z, covariance))))
        powers.append(math.log2(stds[1] / stds[0]))
        weighted.append(math.log2(norms[1] / norms[0]))
    why = (
        "of W in (48), a norm that itself shrinks: under broadband noise it goes like "
        f"gamma^({_listed(weighted, 2)}) for q = 0, 1, 2, 3. Not of the estimates: the standard deviation of x_2 goes like "
        f"gamma^({_listed(powers)}), and under noise of high frequency, of which it is said, a tone at {tone:g} rad/s reaches "
        f"x_2 with a gain like gamma^({_listed(tones)}). What q does buy there is in the next row"
    )
    return Statement(max(*powers, *tones) < 0, float(powers[1]), why)


@PAPER.claim("(37) high frequency", "universal", printed="noise of high frequency is enfeebled by increasing q")
def _():
    """|xhat_2 / y| at omega >> gamma tends to alpha_N gamma^{q+2} / omega^{q+1}: one more q is worth gamma / omega."""
    gamma, ratio = experiment.GAMMA, 20.0
    gains = [_transfer(q, gamma, ratio * gamma) for q in ORDERS]
    far = [_transfer(q, gamma, 1e4 * gamma) * 1e4 ** (q + 1) / gamma for q in ORDERS]
    falls = np.asarray(gains[1:]) / np.asarray(gains[:-1])
    why = (
        f"a tone at {ratio:g} gamma reaches x_2 with gain {_listed(gains)} for q = 0, 1, 2, 3 (gamma = 6, C(n + q, k)): each q "
        f"is worth up to gamma / omega; towards infinity gain * omega^(q+1) / gamma^(q+2) is {_listed(far)}"
    )
    return Statement(bool(np.all(falls < 1)), float(falls[0]), why)


@PAPER.claim("Corollary 2: not amplified", "universal", printed="for high gamma noise is not amplified if q suits gamma")
def _():
    gamma, frequency = 50.0, 500.0
    gains = [_transfer(q, gamma, frequency) for q in range(8)]
    first = next(q for q, gain in enumerate(gains) if gain < 1)
    inside = [max(_transfer(q, gamma, gamma * x, state=1) for x in np.geomspace(0.05, 2, 60)) for q in ORDERS]
    why = (
        f"for noise of high frequency: at gamma = {gamma:g} a tone at {frequency:g} rad/s reaches x_2 with gain below 1 from q "
        f"= {first}. Inside the bandwidth it is amplified for every q: the largest |xhat_1 / y| is {_listed(inside)} for q = "
        "0, 1, 2, 3"
    )
    return Statement(gains[-1] < 1, float(first), why)


@PAPER.claim("noise at equal gamma", "universal", printed="the error becomes smaller and smaller with q", long=True)
def _():
    found = [binomial(q) for q in ORDERS]
    ratios = [one.ratio for one in found]
    falls = bool(np.all(np.diff(ratios) < 0))
    why = (
        f"broadband noise, C(n + q, k): c = {_listed([one.c for one in found], 5)} for q = 0, 1, 2, 3, "
        f"{float(noise_constant(experiment.ALPHAS)):.4g} for (3, 2): C(4, k) is {math.sqrt(found[0].c / found[2].c):.3g} times "
        f"quieter than C(2, k), {1 / ratios[2]:.3g} times than (3, 2). But a larger q at equal gamma is also slower"
    )
    return Statement(falls, f"{_listed(ratios)} of (3, 2)", why)


def _ratios(measure: Measure) -> tuple[list[float], str]:
    ratios = [quietest(measure, q).ratio for q in ORDERS]
    return ratios, f"{_listed(ratios)} of (3, 2)"


@PAPER.claim("noise at equal settling time", "universal", printed="the error becomes smaller and smaller with q", long=True)
def _():
    ratios, said = _ratios("settling time")
    why = (
        "broadband noise, alphas with (10) optimised for q = 0, 1, 2, 3, time to 5 % of its peak from an error of x_2: one "
        f"integrator is worth {1 - ratios[1] / ratios[0]:.2g} of the error; for the next ones the search finds only the "
        "optimum of q = 1 with fast poles added, and the rest is within its tolerance. That it is the global optimum is not "
        "proved"
    )
    return Statement(None, said, why)


@PAPER.claim("noise at equal squared error", "universal", printed="the error becomes smaller and smaller with q", long=True)
def _():
    """c * (int e_x2^2)^3 >= 27/64 for every linear observer: the Kalman filter's bound, reached by q = 0."""
    ratios, said = _ratios("squared error")
    reference = float(noise_constant(experiment.ALPHAS)) / float(speed("squared error", experiment.ALPHAS)) ** 3
    bound = math.sqrt(27 / 64 / reference)
    nothing_left = ratios[0] < 1.001 * bound and min(ratios) > 0.999 * bound
    why = (
        "said at equal gamma; here broadband noise, alphas optimised for q = 0, 1, 2, 3 at an equal integral of the squared "
        f"error of x_2: no linear observer, with any q, is below {bound:.4g} (a Kalman filter attains it), and q = 0 reaches "
        "it. There is nothing for integrators to gain"
    )
    return Statement(not nothing_left, said, why)


@PAPER.claim("noise at equal spectral abscissa", "universal", printed="the error becomes smaller and smaller with q", long=True)
def _():
    ratios, said = _ratios("spectral abscissa")
    why = (
        "broadband noise, alphas optimised for q = 0, 1, 2, 3: all poles meet, alphas C(n + q, k). This measure flatters q: a "
        "multiple pole settles later than its real part says"
    )
    return Statement(bool(np.max(np.diff(ratios)) < 0), said, why)


def _measured(measure: str) -> Statement:
    table = measured_ratios()[measure]
    law = [binomial(q).ratio if measure == "gamma" else quietest(measure, q, spread=SLOW).ratio for q in ORDERS]
    rows = "; ".join(f"q = {q}: {_listed(row)} (law {law[q]:.3g})" for q, row in zip(ORDERS, table, strict=True))
    middle = table[:, 1:3].mean(axis=1)
    off = float(np.max(np.abs(middle / np.asarray(law) - 1)))
    why = (
        f"RMSE of x_2 on the pendulum relative to (3, 2) at gamma = {_listed(GAMMAS)}, medians of {SEEDS} runs; with alpha_N = "
        f"1 no pole is beyond about sqrt(N) exp({SLOW / 2:g}): {rows}"
    )
    return Statement(off < 0.15, f"{_listed(middle)} of (3, 2)", why)


@PAPER.claim("noise at equal gamma, measured", "figure", printed=OURS, long=True)
def _():
    return _measured("gamma")


@PAPER.claim("noise at equal settling time, measured", "figure", printed=OURS, long=True)
def _():
    return _measured("settling time")


@PAPER.claim("noise at equal squared error, measured", "figure", printed=OURS, long=True)
def _():
    return _measured("squared error")


@PAPER.claim("noise at equal spectral abscissa, measured", "figure", printed=OURS, long=True)
def _():
    return _measured("spectral abscissa")
