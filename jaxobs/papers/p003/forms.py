"""Section 2.1: normal forms, constant gains, lemma 1 and theorem 1, and the observer (12)."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._simulate import simulate
from jaxobs.designs import Infeasible, lemma1, riccati_gamma, triangular
from jaxobs.excitation import structure
from jaxobs.observers import Lyapunov
from jaxobs.observers.lyapunov import from_scaled
from jaxobs.papers.claims import OURS, Statement, Value
from jaxobs.papers.p003.inputs import INPUTS, GatedGrowth
from jaxobs.papers.p003.paper import PAPER
from jaxobs.papers.p003.runs import END, GROWTH, all_errors, classified
from jaxobs.plants import FieldMotor, GatedChain, Hovercraft, IntegratorChain, Pendulum
from jaxobs.signals import AbstractSignal

MOTOR = ([-5.0] * 3, [5.0] * 3), ([0.5, -2.0], [1.5, 2.0])  # boxes of states and of (flux, voltage)


@PAPER.claim("(2) shows every input", "universal", printed="uniformly observable")
def _():
    found = structure(Pendulum(), states=([-4.0] * 2, [4.0] * 2), inputs=([-0.5], [0.5]))
    return Statement(found.uniformly_observable, "the pendulum of paper 000", found.why)


@PAPER.claim("(3) converges for theta large", "universal", printed="theta large, g globally Lipschitz, A + K C Hurwitz")
def _():
    observer, certificate = triangular(Pendulum(), slopes=1.5, gain=[3.0, 2.0])
    gain, theta = ", ".join(f"{g:.4g}" for g in np.asarray(observer.gain)[:, 0]), float(observer.gain[0, 0]) / 3.0
    why = (
        f"with K = (3, 2) and slopes up to 1.5 every theta >= {theta / 1.1:.4f} is certified by P of lemma 1 "
        f"(exact; L = ({gain}) at theta = {theta:.4f}); (5) of paper 000 needs gamma = "
        f"{riccati_gamma(alphas=[3.0, 2.0], lipschitz=1.5):.4f} for the same chain"
    )
    return Statement(bool(certificate.verify()), theta / 1.1, why)


@PAPER.claim("(5) rank for several outputs", "universal", printed="Rank dF_i/dz_{i+1} = n_{i+1}")
def _():
    states = [-5.0] * 5, [5.0] * 5
    on = structure(Hovercraft(), states=states, inputs=([0.5, -3.0], [1.5, 3.0]))
    off = structure(Hovercraft(), states=states, inputs=([0.0, -3.0], [1.5, 3.0]))
    holds = on.uniformly_observable and not off.uniformly_observable
    why = f"a craft with blocks (2, 2, 1) satisfies it while its throttle is open; with the throttle at 0: {off.why}"
    return Statement(holds, float(np.min(on.lower)), why)


@PAPER.claim("(4) block observer", "universal", printed="extends to several outputs [6]", long=True)
def _():
    plant = Hovercraft()
    ts = np.arange(0, 8.005, 0.01)
    run = simulate(
        plant,
        Lyapunov(plant, jnp.asarray(6.0), jnp.eye(5)),
        x0=[0.0, 0.0, 1.0, -1.0, 2.0],
        xhat0=np.zeros(5),
        ts=ts,
        signal=_Throttle(),
    )
    error = jnp.linalg.norm(run.x - run.xhat, axis=1)
    why = "blocks (2, 2, 1), nonlinear drag, throttle cos t, heading t / 2, (25) with theta = 6: |e(8)| / |e(0)|"
    ratio = float(error[-1] / error[0])
    return Statement(ratio < 1e-6, ratio, why)


class _Throttle(AbstractSignal):
    """(cos t, t / 2): throttle and heading."""

    m = 2

    def __call__(self, t):
        return jnp.stack([jnp.cos(t), t / 2])


@PAPER.claim("lemma 1 (6)", "universal", printed="0 < a <= a_i <= a': K, P, alpha exist", long=True)
def _():
    wide = [lemma1([0.1] * k, [10.0] * k) for k in (1, 2, 3)]
    holds = all(one.certificate.verify() for one in wide)
    rates = ", ".join(f"{one.certificate.rate:.3g}" for one in wide)
    why = (
        f"a_i in [0.1, 10], n = 2, 3, 4: K and P proved at all corners (exact, since (6) is affine in a) with the rates "
        f"{rates} 1/s"
    )
    return Statement(holds, wide[-1].certificate.rate, why)


@PAPER.claim("lemma 1 needs a > 0", "universal", printed="0 < a")
def _():
    try:
        lemma1([0.5, -0.5], [1.5, 1.0])
    except Infeasible as no:
        return Statement(True, no.margin, no.reason)
    return Statement(False, 0.0, "a K was found although a_2 may vanish")


@PAPER.claim("theorem 1: K of lemma 1 for |a_i|", "universal", printed="K is the constant gain stated in lemma 1")
def _():
    one = lemma1([0.5, 0.5], [1.5, 1.5])
    other = lemma1([-1.5, 0.5], [-0.5, 1.5])

    def growth(gain):
        return float(np.max(np.linalg.eigvals(np.diag([-1.0, 1.0], 1) - np.outer(gain, [1.0, 0, 0])).real))

    why = (
        "lemma 1 has 0 < a <= a_i, theorem 1 only |a_i| >= a with a constant sign: for a_1 = -1, a_2 = 1 the K of a_i > 0 "
        f"leaves max Re = {growth(one.gain):.3f}. What is meant, and true: K up to the change of signs z_i -> s_i z_i, "
        f"s_{{i+1}} = s_i sign(a_i), which gives max Re = {growth(other.gain):.3f}"
    )
    return Statement(False if growth(one.gain) > 0 and growth(other.gain) < 0 else None, growth(one.gain), why)


@PAPER.claim("theorem 1 (7)", "universal", printed="an exponential observer for theta > theta_0", long=True)
def _():
    plant = FieldMotor()
    seen = structure(plant, states=MOTOR[0], inputs=MOTOR[1])
    slopes = np.array([[2.0, 0, 0], [3.0, 1.0, 0], [0, 0, 0]])  # 1 = (c / w_c + d) / J, the friction at standstill
    observer, certificate = triangular(plant, slopes=slopes, couplings=(seen.lower, seen.upper))
    ts = np.arange(0, 6.0, 0.002)
    run = simulate(
        plant, observer, x0=[0.0, 2.0, 0.5], xhat0=np.zeros(3), ts=ts, signal=_Field(),
    )  # fmt: skip
    error = jnp.linalg.norm(run.x - run.xhat, axis=1)
    theta = float(observer.gain[0, 0] / lemma1(seen.lower, seen.upper).gain[0])
    why = (
        f"a motor with a_1 in [{seen.lower[0]:g}, {seen.upper[0]:g}] and friction: certified from theta = "
        f"{theta / 1.1:.4f} on; simulated at {theta:.4f}, |e(6)| / |e(0)| = {error[-1] / error[0]:.2g}"
    )
    return Statement(bool(certificate.verify()) and float(error[-1] / error[0]) < 1e-3, theta / 1.1, why)


class _Field(AbstractSignal):
    """(1 + 0.5 sin t, 1): flux and voltage."""

    m = 2

    def __call__(self, t):
        return jnp.stack([1 + 0.5 * jnp.sin(t), jnp.ones_like(t)])


@PAPER.claim("(8) may hide states", "universal", printed="inputs that render it unobservable")
def _():
    found = structure(GatedGrowth(), states=([-1.0] * 2, [1.0] * 2), inputs=([-1.0], [1.0]))
    return Statement(not found.uniformly_observable, float(found.lower[0]), found.why)


@PAPER.claim("(12) is (25)", "identity", printed="two observers")
def _():
    rng = np.random.default_rng(0)
    theta, gamma, n = 3.0, 2.0, 3
    root = rng.normal(size=(n, n))
    s12 = root @ root.T + np.eye(n)
    a, c, delta = np.diag(rng.normal(size=n - 1), 1), np.eye(1, n), np.diag(theta ** np.arange(1, n + 1))
    rate12 = -theta * (gamma * s12 + a.T @ s12 + s12 @ a - c.T @ c)
    rate, s25 = (np.asarray(part) for part in from_scaled(jnp.asarray(theta), jnp.asarray(gamma), s12))
    rate25 = -rate * s25 - a.T @ s25 - s25 @ a + c.T @ c
    inverse = np.linalg.inv(delta)
    moved = theta * inverse @ rate12 @ inverse
    gains = delta @ np.linalg.solve(s12, c.T) - np.linalg.solve(s25, c.T)
    residual = max(np.max(np.abs(moved - rate25)) / np.max(np.abs(rate25)), np.max(np.abs(gains)))
    why = (
        "S_25 = theta Delta^-1 S_12 Delta^-1 and theta_25 = gamma theta_12 turn (12) into (25), gain included, for every A(u) "
        f"of the form (9): relative residual {residual:.1g} at a random point. Theorems 2 and 3 speak of one observer"
    )
    return Statement(bool(residual < 1e-11), float(residual), why)


@PAPER.claim("(12) equation of S_0", "value", printed="-1")
def _():
    """The sign of C'C, and turned round those of A'S_0 and S_0 A, in S_0' = -gamma S_0 + A'S_0 + S_0 A - C'C."""
    gamma = 2.0
    a, c = np.eye(2, k=1), np.eye(1, 2)

    def steady(sign):  # of gamma S + sign (A'S + S A) = sign' C'C with the signs of the print (-1) or turned round (+1)
        operator = gamma * np.eye(4) + sign * (np.kron(a.T, np.eye(2)) + np.kron(np.eye(2), a.T))
        return np.linalg.solve(operator, sign * (c.T @ c).reshape(-1)).reshape(2, 2)

    printed, right = (np.linalg.eigvalsh(steady(sign)) for sign in (-1, 1))
    why = (
        f"the sign of C'C: as printed the steady state has the eigenvalues {printed[0]:.4f}, {printed[1]:.4f} for A the shift "
        "and gamma = 2: negative definite, so alpha_0 I <= S_0 cannot hold. With -gamma S_0 - A'S_0 - S_0 A + C'C, as in the "
        f"equation of S above it, they are {right[0]:.4f}, {right[1]:.4f}"
    )
    return Value(1.0 if printed[0] < 0 < right[0] else math.nan, why)


@PAPER.claim("theorem 2 (12)", "universal", printed="an observer for locally regular inputs", long=True)
def _():
    regular = [name for name in INPUTS if classified(name).locally_regular]
    worst = max(max(all_errors()[name].scaled, all_errors(True)[name].scaled) for name in regular)
    why = (
        f"|e({END:g})| / |e(0)| at most, over {', '.join(regular)}; theta = gamma = 2; on example 1 and with x2' = "
        f"{GROWTH:g} x2"
    )
    return Statement(worst < 1e-6, worst, why)


@PAPER.claim("(25) is 001's tracker", "identity", printed=OURS, long=True)
def _():
    plant, mu = IntegratorChain(3), 4.0
    s = Lyapunov(plant, jnp.asarray(mu), jnp.eye(3))
    ts = jnp.arange(0, 5.0, 0.01)
    zero = jnp.zeros((0,))
    run = simulate(plant, s, x0=np.ones(3), xhat0=np.zeros(3), ts=ts)
    steady = [3 * mu, 3 * mu**2, mu**3]
    closed = np.asarray(
        [[1 / mu, -1 / mu**2, 1 / mu**3], [-1 / mu**2, 2 / mu**3, -3 / mu**4], [1 / mu**3, -3 / mu**4, 6 / mu**5]]
    )
    gain = np.asarray(s.gain(jnp.asarray(closed), zero))[:, 0]
    rate = s.flow(jnp.zeros(()), (jnp.zeros(3), jnp.asarray(closed)), zero, jnp.zeros(1))[1]
    residual = max(float(np.max(np.abs(gain / steady - 1))), float(jnp.max(jnp.abs(rate))))
    why = (
        f"A the shift: the steady S gives the gains C(3, i) theta^i, Gauthier's and 001's (residual {residual:.1g}); from "
        f"S(0) = I, |e(5)| / |e(0)| = {float(jnp.linalg.norm((run.x - run.xhat)[-1]) / np.sqrt(3)):.2g}"
    )
    return Statement(residual < 1e-10, residual, why)


@PAPER.claim("example 1 is state affine", "universal", printed="(24)")
def _():
    a, c = jax.vmap(GatedChain().pair)(jnp.asarray([[0.0], [1.0]]))
    rank = [int(np.linalg.matrix_rank(np.concatenate([c[k], c[k] @ a[k]]))) for k in (0, 1)]
    return Statement(rank == [1, 2], f"rank {rank[0]} at u = 0, {rank[1]} at u = 1", "x_2 is seen only while u is away from 0")
