"""Sections 2.2 and 3, (11)-(23): Gramians, proposition 1, the equation of S, remarks 1 and 2, example 1."""

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import Chebyshev

from jaxobs.excitation import fading_gramians, window_gramians
from jaxobs.excitation.gramian import pair_of
from jaxobs.observers import Lyapunov
from jaxobs.papers.claims import Bound, Statement
from jaxobs.papers.p003.inputs import INPUTS, THETAS
from jaxobs.papers.p003.paper import PAPER
from jaxobs.papers.p003.runs import classified, solve_s
from jaxobs.plants import FieldMotor, GatedChain, IntegratorChain

NONE = np.zeros(0)
DEGREE = 40  # of the polynomials that stand for the integrands: their remainder is below rounding here


def motor_input(t: float) -> list[float]:
    """(flux, voltage): a_1 = -2 - sin t, a_2 = -2 for the motor's default numbers."""
    return [1 + 0.5 * np.sin(t), 1.0]


def nested(couplings, t: float, window: float) -> list[Chebyshev]:
    """alpha_1, ..., alpha_n of (14) as polynomials in s on [t - window, t], by repeated integration from t."""
    domain = (t - window, t)
    row, rows = Chebyshev([1.0], domain), [Chebyshev([1.0], domain)]
    for i in range(len(couplings)):
        row = Chebyshev([1.0], domain)
        for a in reversed(couplings[: i + 1]):
            inside = Chebyshev.interpolate(lambda s, a=a, row=row: a(s) * row(s), DEGREE, domain)
            row = inside.integ(lbnd=t)
        rows.append(row)
    return rows


def _motor_window(theta: float, t: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """(15) of the motor: by repeated integrals, and by the collocation of `window_gramians`."""
    rows = nested((lambda s: -2 - np.sin(s), lambda s: -2.0 + 0 * s), t, 1 / theta)

    def integral(left, right):
        whole = Chebyshev.interpolate(lambda s: left(s) * right(s), DEGREE, (t - 1 / theta, t)).integ(lbnd=t - 1 / theta)
        return whole(t)

    by_hand = np.asarray([[integral(left, right) for right in rows] for left in rows])
    pair = pair_of("p003", FieldMotor(), motor_input)
    return by_hand, window_gramians(pair, np.asarray([t]), theta, NONE).full()[0, 0]


@PAPER.claim("(13)-(15) repeated integrals", "identity", printed="psi_ij of (14)")
def _():
    by_hand, ours = _motor_window(2.0)
    scale = np.sqrt(np.outer(np.diag(by_hand), np.diag(by_hand)))
    residual = float(np.max(np.abs(by_hand - ours) / scale))
    return Statement(residual < 1e-8, residual, "a motor with a_1 = -2 - sin t, a_2 = -2: (13)-(15) against collocation of phi")


@PAPER.claim("(16) from (11)", "universal", printed="psi_ii >= beta / theta^{2i-1}")
def _():
    found, theta = classified("1 + 0.5 sin t"), 8.0
    pair = pair_of("p003", GatedChain(), INPUTS["1 + 0.5 sin t"].signal)
    times = np.linspace(2.0, 14.0, 400)
    diagonal = np.diagonal(window_gramians(pair, times, theta, NONE).full()[:, 0], axis1=-2, axis2=-1)
    beta = float(np.min(diagonal * theta ** np.asarray([1.0, 3.0])))
    alpha = float(found.regularity.worst[1])
    return Statement(beta >= alpha, beta, f"u = 1 + 0.5 sin t: beta = {beta:.4g} >= alpha = {alpha:.4g} of (11) at theta = 8")


@PAPER.claim("(16) domain", "bound", printed="32")
def _():
    """The time from which (16) holds at theta = 32 and t_0 = 0, for u = 1: max{t_0, theta} as printed, max{t_0, 1/theta_0}."""
    theta, least = 32.0, min(THETAS)
    pair = pair_of("p003", GatedChain(), INPUTS["1"].signal)
    value = float(window_gramians(pair, np.asarray([1 / least]), theta, NONE).full()[0, 0, 1, 1] * theta**3)
    why = (
        f"at theta = {theta:g} and t_0 = 0: t >= max{{t_0, theta}} is valid, but theta is 1/time; definition 1 says t >= "
        f"max{{1/theta_0, t_0}}, and (16) holds from there on: u = 1, theta_0 = {least:g}, t = {1 / least:g}, theta^3 psi_22 = "
        f"{value:.6f}. The printed domain recedes as theta grows. The same after (18)"
    )
    return Bound(1 / least if value > 0.3 else theta, "upper", why)


def _ratios(name: str, theta: float) -> np.ndarray:
    pair = pair_of("p003", GatedChain(), INPUTS[name].signal)
    times = np.linspace(2.0, 10.0, 161)
    psi = window_gramians(pair, times, theta, NONE).full()[:, 0, 1, 1]
    peaks = np.asarray([np.max(np.asarray(pair.inputs(np.linspace(t - 1 / theta, t, 65))) ** 2) for t in times])
    return psi * 3 * theta**3 / peaks


@PAPER.claim("(17)", "universal", printed="psi_22 <= max a_1^2 / (3 theta^3)")
def _():
    worst = max(float(np.max(_ratios(name, 4.0))) for name in ("1", "1 + 0.5 sin t", "cos t", "cos^3 t"))
    return Statement(worst <= 1 + 1e-9, worst, "the largest psi_22 over its bound, theta = 4: equal for u = 1")


@PAPER.claim("(18)", "universal", printed="psi_ii <= gamma_i / ((2i-1) ((i-1)!)^2 theta^{2i-1})")
def _():
    theta = 2.0
    pair = pair_of("p003", IntegratorChain(4), lambda t: np.zeros(0))
    psi = np.diag(window_gramians(pair, np.asarray([3.0]), theta, NONE).full()[0, 0])
    bound = np.asarray([1 / ((2 * i - 1) * np.prod(np.arange(1.0, i)) ** 2 * theta ** (2 * i - 1)) for i in (1, 2, 3, 4)])
    motor, _ = _motor_window(theta)
    peak = 9 * 4  # max a_1^2 max a_2^2 <= (2 + 1)^2 2^2
    worst = max(float(np.max(psi / bound)), motor[2, 2] / (peak * bound[2]))
    return Statement(worst <= 1 + 1e-9, worst, "equal for a_i = 1, n = 4; smaller for a motor with a_1 = -2 - sin t")


@PAPER.claim("proposition 1", "universal", printed="continuous and locally regular: |a_i(u(t))| >= a > 0, one sign", long=True)
def _():
    regular = [name for name in INPUTS if classified(name).locally_regular and not INPUTS[name].breaks]
    lowest = min(float(classified(name).lowest[0]) for name in regular)
    holds = all(classified(name).constant_gain for name in regular) and lowest > 0
    why = (
        f"of the continuous inputs {', '.join(regular)} are locally regular; |a_1| >= {lowest:.4g} for them, without a "
        f"change of sign"
    )
    return Statement(holds, lowest, why)


@PAPER.claim("proposition 1 needs continuity", "universal", printed="continuous")
def _():
    found = classified("sign(cos t)")
    holds = found.locally_regular and bool(found.sign_changes[0])
    why = "sign(cos t) is locally regular, yet a_1 changes its sign: the hypothesis is needed (|a_1| >= a holds all the same)"
    return Statement(holds, float(found.regularity.worst[-1]), why)


def _first_term(theta: float, t: float) -> np.ndarray:
    """e^{-theta t} Phi(0,t)'S(0)Phi(0,t) for u = cos t on example 1 and S(0) = I: int_0^t cos = sin t."""
    back = np.asarray([[1.0, -np.sin(t)], [0.0, 1.0]])
    return np.exp(-theta * t) * back.T @ back


@PAPER.claim("(19)-(20) solution", "identity", printed="S = e^{-theta t} Phi'S(0)Phi + int ...")
def _():
    theta, t, plant, signal = 3.0, 2.0, GatedChain(), INPUTS["cos t"].signal
    s = solve_s(Lyapunov(plant, jnp.asarray(theta), jnp.eye(2)), signal, t)
    psi = fading_gramians(pair_of("p003", plant, signal), np.linspace(0, t, 201), np.asarray([theta])).full()[-1, 0]
    residual = float(np.max(np.abs(s - psi - _first_term(theta, t))) / np.max(np.abs(s)))
    return Statement(residual < 1e-10, residual, "u = cos t on example 1, theta = 3, t = 2: (19) integrated, against (20)")


@PAPER.claim("(20) growth of Phi", "universal", printed="|Phi(s, t)| <= e^{m (t - s)}, m = |A(u)|_inf")
def _():
    ages = np.linspace(0.01, 6.0, 600)
    norms = [np.linalg.norm(np.asarray([[1.0, -age], [0.0, 1.0]]), 2) for age in ages]
    worst = float(np.max(norms / np.exp(ages)))
    return Statement(
        worst <= 1, worst, "u = 1 (m = 1): the largest |Phi| e^{-m (t-s)}; for nilpotent A(u) Phi grows like a power only"
    )


@PAPER.claim("remark 1.1 (22)", "universal", printed="theta > 2m: |S - Psi| <= omega e^{-(theta - 2m) t}")
def _():
    ratios = []
    for t in (0.5, 2.0, 5.0):
        ratios.append(float(np.linalg.norm(_first_term(3.0, t), 2) / np.exp(-(3.0 - 2.0) * t)))
    why = (
        "u = cos t (m = 1), theta = 3, S(0) = I, omega = |S(0)| = 1: the largest |S - Psi| over its bound. Since A(u) is "
        "nilpotent, theta > 0 is enough: Phi(0, t) grows like t^{n-1}"
    )
    return Statement(max(ratios) <= 1, max(ratios), why)


@PAPER.claim("remark 1.2 sign of Psi_1i", "identity", printed="Psi_12 = int e^{-theta(t-s)} int_s^t A_12")
def _():
    theta = 4.0
    pair = pair_of("p003", GatedChain(), INPUTS["1"].signal)
    psi = fading_gramians(pair, np.linspace(0, 10.0, 401), np.asarray([theta])).full()[-1, 0]
    printed = 1 / theta**2
    why = (
        f"u = 1, theta = 4: Psi_12 = {psi[0, 1]:.6f}, printed {printed:.6f}. phi(s, t) runs backwards, so "
        "int_s^t should read int_t^s: a factor (-1)^{i-1} in Psi_1i, (-1)^{i+j} in Psi_ij. The diagonal, "
        "all that definition 2 and (23) use, is not touched"
    )
    wrong = abs(psi[0, 1] + printed) < 1e-9
    return Statement(False if wrong else None, float(psi[0, 1]), why)


@PAPER.claim("remark 1.2 inner limits", "identity", printed="int_s^t int_s^{t_1} ... A_12(u(t_1)) ... A_{i-1,i}")
def _():
    t, window = 3.0, 1.0
    rows = nested((lambda s: 1.0 + 0 * s, np.cos), t, window)
    s = t - window
    ours = float(rows[2](s))
    # printed: int_s^t a_1(t_1) int_s^{t_1} a_2(t_2) dt_2 dt_1, with a_1 = 1, a_2 = cos
    printed = float(np.cos(s) - np.cos(t) - (t - s) * np.sin(s))
    right = float((t - s) * np.sin(t) - (np.cos(s) - np.cos(t)))
    why = (
        f"a_1 = 1, a_2 = cos, t = 3, s = 2: the entry of C phi(s, t) is {ours:.6f} = int_s^t int_{{t_1}}^t, which (14) gives "
        f"too ({right:.6f}); with the printed inner limits s, t_1 it is {printed:.6f}. They agree only for constant couplings"
    )
    return Statement(False if abs(ours - right) < 1e-9 < abs(ours - printed) else None, ours, why)


@PAPER.claim("(23) Gamma > 0 by construction", "universal", printed="positive definite")
def _():
    pair = pair_of("p003", GatedChain(), INPUTS["0"].signal)
    gamma = np.diag(fading_gramians(pair, np.linspace(0, 5.0, 81), np.asarray([4.0])).full()[-1, 0])
    why = "u = 0 gives Psi_22 = 0: Gamma is >= 0 by construction, and definition 2 i) rightly asks for its inverse"
    return Statement(False if gamma[1] == 0 else None, float(gamma[1]), why)


@PAPER.claim("remark 2: C_LR in C_SP", "universal", printed="C_LR subset of C_SP")
def _():
    regular = [name for name in INPUTS if classified(name).locally_regular]
    holds = all(classified(name).persistent for name in regular)
    theta, worst = 8.0, np.inf
    for name in regular:
        pair, cuts = pair_of("p003", GatedChain(), INPUTS[name].signal), np.asarray(INPUTS[name].breaks)
        grid = np.unique(np.concatenate([np.linspace(0, 8.0, 257), cuts[cuts < 8.0]]))
        psi = fading_gramians(pair, grid, np.asarray([theta])).full()[:, 0]
        late = grid > 1.0
        window = window_gramians(pair, grid[late], theta, cuts).full()[:, 0]
        graded = theta ** (np.arange(1, 3) - 0.5)
        difference = (psi[late] - np.exp(-1.0) * window) * np.outer(graded, graded)
        worst = min(worst, float(np.min(np.linalg.eigvalsh(difference))))
    why = (
        "Psi(t, theta) >= e^{-1} G(t - 1/theta, t) >= e^{-1} alpha theta Delta^-2, and Gamma is bounded as in (18), so "
        f"alpha(theta) in i) is constant; iii) follows as well. Locally regular here: {', '.join(regular)}; all of them pass "
        "i) to iii). ours: the smallest eigenvalue of Delta (Psi - G / e) Delta / theta over them"
    )
    return Statement(holds and worst > -1e-12, worst, why)


@PAPER.claim("example 1: cos t", "universal", printed="in C_SP, not in C_LR")
def _():
    found = classified("cos t")
    power = found.regularity.power(found.thetas)
    why = (
        f"the alpha of (11) falls like theta^{power:.2f} (at the zeros of cos t), alpha(theta) "
        f"of i) stays at {found.alpha.worst[-1]:.4f}, gamma at {found.gamma.worst[-1]:.4g}; iii) "
        f"{'holds' if found.lasting else 'fails'} too. {found.why}"
    )
    return Statement(found.strongly_persistent and not found.locally_regular, float(found.alpha.worst[-1]), why)


@PAPER.claim("definition 2 admits lost states", "universal", printed="i) and ii)")
def _():
    """For t >= 2 by Cauchy and Schwarz Psi_12^2 <= e^{-theta (t - 1)} Psi_11 Psi_22, so i) holds with alpha(theta) =
    1 / (1 - e^{-theta/2}); and Psi_22 <= e^{-theta (t - 1)} / theta since int u < 1, which is ii).
    """
    found, theta = classified("a bump, then 0"), 4.0
    first, last = found.floor.halves[0]
    grid = np.linspace(0, 8.0, 257)
    psi = fading_gramians(pair_of("p003", GatedChain(), INPUTS["a bump, then 0"].signal), grid, np.asarray([theta])).full()
    late = psi[grid >= 2.0, 0]
    fades = np.exp(-theta * (grid[grid >= 2.0] - 1))
    bound = float(np.max(late[:, 0, 1] ** 2 / (late[:, 0, 0] * late[:, 1, 1] * fades)))
    why = (
        "a bump over 1 s followed by u = 0 passes i) and ii): as S_22 dies out, Psi becomes diagonal, which is what i) "
        "measures. In closed form, for t >= 2: Psi_12^2 <= e^{-theta (t-1)} Psi_11 Psi_22 (largest ratio on a grid "
        f"{bound:.3g}), so alpha(theta) = 1 / (1 - e^{{-theta/2}}) will do. Needed besides: iii) Psi(t, theta) >= c(theta) I; "
        f"here lambda_min(Psi) at theta = {theta:g} falls from {first:.2g} (first half) to {last:.2g} (second half)"
    )
    return Statement(found.strongly_persistent and not found.lasting and bound <= 1, float(last), why)
