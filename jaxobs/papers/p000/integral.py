"""(37)-(48), corollary 2: the q-integral observer, its input-to-state gain, and the form in which it can run."""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs import chain_bounds, hurwitz
from jaxobs._module import Scalar, astype, param, static
from jaxobs.designs import riccati, riccati_gamma
from jaxobs.observers import AbstractFlowObserver, HighGain, IntegralHighGain
from jaxobs.papers.claims import Statement
from jaxobs.papers.p000 import experiment
from jaxobs.papers.p000.paper import PAPER
from jaxobs.papers.p000.weights import riccati_pair
from jaxobs.plants import AbstractChain, Pendulum

Q = 2  # of figure 3
C4 = [4.0, 6.0, 4.0, 1.0]


class AsPrinted(AbstractFlowObserver):
    """(37) and (40) as printed: xi_i' = xi_{i+1}, xi_q' = y, and eta_hat' = A~ eta_hat + f~ + Z C~'(xi_1 - eta_hat_1).

    For comparison only: xi is the q-fold integral of y and grows without bound. z = (xi, eta_hat), q >= 1.
    """

    model: AbstractChain
    alphas: Float[Array, " N"] = param()
    gamma: Scalar = param()
    q: int = static(default=Q)
    p = 1

    @property
    def n(self):
        return self.model.n

    @property
    def m(self):
        return self.model.m

    def init(self, xhat0):
        return jnp.concatenate([jnp.zeros((2 * self.q,), xhat0.dtype), xhat0])

    def flow(self, t, z, u, y):
        xi, eta = z[: self.q], z[self.q :]
        order = jnp.arange(1, self.n + self.q + 1, dtype=self.gamma.dtype)
        drift = jnp.concatenate([eta[1 : self.q + 1], self.model.flow(t, eta[self.q :], u)])
        return jnp.concatenate([xi[1:], y, drift + self.alphas * self.gamma**order * (xi[0] - eta[0])])

    def estimate(self, t, z, u, y):
        return z[2 * self.q :]

    def predict(self, t, z, u):
        return self.model.h(z[2 * self.q :], u)


def _array(x: float) -> jnp.ndarray:
    return jnp.asarray(float(x))


def _augmented() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(A~, C~, Z, Q~) at gamma = 6, n = 2, q = 2, alphas C(4, k)."""
    z, weight = (np.asarray(m) for m in riccati_pair(jnp.asarray(C4), _array(experiment.GAMMA)))
    return np.eye(4, k=1), np.eye(1, 4), z, weight


@PAPER.claim("(37)", "identity", printed="xi_1 = xi_2", scan=True)
def _():
    """xi_1 = int xi_2, of a record: equal only if the dot is restored."""
    ts = np.arange(0.0, 2.0, 1e-3)
    y = np.asarray(experiment.run(experiment.plain(), noisy=False, end=2.0, period=1e-3).y)[:, 0]
    xi2 = np.concatenate([[0], np.cumsum((y[1:] + y[:-1]) / 2)]) * 1e-3
    xi1 = np.concatenate([[0], np.cumsum((xi2[1:] + xi2[:-1]) / 2)]) * 1e-3
    literal, derivative = float(np.max(np.abs(xi1 - xi2))), float(np.max(np.abs(np.gradient(xi1, ts)[1:-1] - xi2[1:-1])))
    why = (
        f"the dot of xi_1 is lost: along the pendulum |xi_1 - xi_2| reaches {literal:.3g} within 2 s, |xi_1' - xi_2| "
        f"{derivative:.1g}"
    )
    return Statement(literal < 1e-6, literal, why)


@PAPER.claim("(40)", "identity", printed="... - Z C~'C Z + Q~ = 0", scan=True)
def _():
    a, c, z, weight = _augmented()
    residual = float(np.max(np.abs(a @ z + z @ a.T - z @ c.T @ c @ z + weight) / np.max(weight)))
    why = (
        f"the tilde of the second C is lost: C has n = 2 columns, Z has {len(z)} rows. With C~ the relative residual is "
        f"{residual:.2g}"
    )
    return Statement(experiment.plain().n == len(z), residual, why)


@PAPER.claim("(41)-(43)", "identity", printed="A~'Z^-1 + Z^-1 A~ + Z^-1 Q~ Z^-1 - C~'C~ = 0")
def _():
    a, c, z, weight = _augmented()
    inverse = np.linalg.inv(z)
    middle = inverse @ weight @ inverse
    residual = float(np.max(np.abs(a.T @ inverse + inverse @ a + middle - c.T @ c)) / np.max(np.abs(middle)))
    return Statement(residual < 1e-10, residual, "relative residual at gamma = 6, n = 2, q = 2, alphas C(4, k)")


@PAPER.claim("(44) figure 3", "universal", printed="C1 > 0 for figure 3 (its gamma is not given)")
def _():
    rate = float(chain_bounds.decay_rate(jnp.asarray(C4), _array(experiment.GAMMA), _array(experiment.RHO)))
    smallest = riccati_gamma(alphas=C4, lipschitz=experiment.RHO)
    why = (
        f"the paper leaves gamma open. At the gamma = 6 of (71), C1 = {rate:.4g} for C(4, k): (44) certifies gamma > "
        f"{smallest:.6g} only. That is the certificate's limit, not the observer's: see '(65) q = 2', and the S-lemma rows"
    )
    return Statement(None, rate, why)


@PAPER.claim("(45)", "universal", printed="V' <= -C1 V + 2 sqrt(V) |Z^-1/2 B| |w|")
def _():
    """2 e'Z^-1 B w <= 2 |Z^-1/2 e| |Z^-1/2 B| |w|, equality for e along B; the rest is (24). |Z^-1/2 B| by its root, at gamma
    = 6.
    """
    _, _, z, _ = _augmented()
    values, vectors = np.linalg.eigh(z)
    root = (vectors / np.sqrt(values)) @ vectors.T
    literal = float(np.linalg.norm(root[:, Q - 1]))
    closed = float(chain_bounds.noise_injection(jnp.asarray(C4), _array(experiment.GAMMA), Q))
    return Statement(
        abs(literal / closed - 1) < 1e-6, closed, f"|Z^-1/2 B| = {closed:.6g} at gamma = 6, by the root and in closed form"
    )


@PAPER.claim("(46)", "identity", printed="Z = D Z~ D / gamma")
def _():
    a, c, _, _ = _augmented()
    gamma = experiment.GAMMA
    d = gamma ** np.arange(1.0, 5.0)
    at_one = np.asarray(riccati_pair(jnp.asarray(C4), _array(1.0))[0])
    z, weight = at_one * np.outer(d, d) / gamma, np.diag(np.asarray(hurwitz.q_from_alphas(C4)) * d**2)
    residual = float(np.max(np.abs(a @ z + z @ a.T - z @ c.T @ c @ z + weight) / np.outer(d, d)))
    return Statement(residual < 1e-12, residual, "residual of the Riccati equation at gamma = 6, entries scaled")


@PAPER.claim("(48) C", "identity", printed="W' <= -C/2 W + ...", scan=True)
def _():
    rate = float(chain_bounds.decay_rate(jnp.asarray(C4), _array(50.0), _array(experiment.RHO)))
    return Statement(
        False, rate, f"C stands for C1 of (44), for instance {rate:.4g} at gamma = 50, C(4, k), rho = 3/2: the index is lost"
    )


@PAPER.claim("(48) C2", "universal", printed="|Z^-1/2 B| <= C2 gamma^-q/2, C2 = lambda_max(Z~^-1)")
def _():
    alphas, q = jnp.asarray(experiment.ALPHAS), 1
    exact = float(chain_bounds.noise_injection(alphas, _array(1.0), q))
    inverse = np.linalg.inv(np.asarray(riccati_pair(alphas, _array(1.0))[0]))
    printed = float(np.linalg.eigvalsh(inverse)[-1])
    why = (
        f"n = q = 1, alphas (3, 2), gamma = 1: |Z^-1/2 B| = {exact:.4g}, C2 = {printed:.4g}: a square root is missing. In "
        "general it is gamma^{1/2-q} sqrt((Z~^-1)_qq), so (48) holds for gamma >= 1 with C2 = sqrt((Z~^-1)_qq)"
    )
    return Statement(exact <= printed, exact / printed, why)


@PAPER.claim("(48) input-to-state stable", "universal", printed="(48) is input-to-state stability with respect to the noise")
def _():
    gammas = (1000.0, 2000.0)
    gains = [float(chain_bounds.iss_gain(jnp.asarray(C4), _array(g), _array(experiment.RHO), Q)[1]) for g in gammas]
    power = np.log2(gains[1] / gains[0])
    why = (
        f"yes, with (44); in physical units the proved gain from sup|w| to x_2 is {gains[0]:.4g} at gamma = {gammas[0]:g} and "
        f"{gains[1]:.4g} at {gammas[1]:g} (q = 2, C(4, k)): it grows like gamma^{power:.2f}, for W is a norm that shrinks with "
        "gamma"
    )
    return Statement(bool(np.all(np.isfinite(gains))), gains[0], why)


@PAPER.claim("Corollary 2: stable", "universal", printed="(44) and w = 0: globally exponentially stable")
def _():
    alphas, q = [3.0, 3.0, 1.0], 1
    gamma = 1.1 * riccati_gamma(alphas=alphas, lipschitz=experiment.RHO)
    _, certificate = riccati(Pendulum(), alphas=alphas, gamma=gamma, q=q, lipschitz=experiment.RHO)
    verdict = certificate.verify()
    rate = verdict.margins["decay_rate_of_V"]
    return Statement(verdict.holds, rate, f"exactly, at gamma = {gamma:.5g} for C(3, k), q = 1, rho = 3/2: V' <= -{rate:.4g} V")


@PAPER.claim("Corollary 2: decouples", "universal", printed="noise is decoupled from the observer gain", long=True)
def _():
    """In (41) w enters by B, whatever gamma is: the observers' derivative by y. And the transfer from w to xhat_1 at frequency
    0, phi left out: e' = F e + B w, from the linear system.
    """
    ways, gains = [], []
    for gamma in (6.0, 60.0):
        robust = IntegralHighGain(Pendulum(), C4, gamma, Q)
        plain = HighGain(Pendulum(), experiment.ALPHAS, gamma)
        ways.append([float(jnp.linalg.norm(_way_in(one))) for one in (robust, plain)])
        flow = np.eye(4, k=1)
        flow[:, 0] -= np.asarray(C4) * gamma ** np.arange(1.0, 5.0)
        gains.append(float(-np.linalg.solve(flow, np.eye(4)[Q - 1])[Q]))
    why = (
        f"in (41) the noise enters by B, of size {ways[0][0]:g} at gamma = 6 and {ways[1][0]:g} at 60; for q = 0 by the gain, "
        f"of size {ways[0][1]:.4g} and {ways[1][1]:.4g}. Its effect on the estimate does depend on gamma, see the rows on "
        "noise, and what is attenuated is noise above the bandwidth: an offset in y passes to xhat_1 with gain "
        f"{abs(gains[0]):.6g} at both gammas (difference {abs(gains[1] - gains[0]):.1g}), for every q"
    )
    return Statement(ways[0][0] == ways[1][0], ways[0][0], why)


def _way_in(observer: AbstractFlowObserver) -> jnp.ndarray:
    """The derivative of the observer's right-hand side by y."""
    z, u, y = observer.init(jnp.zeros(2)), jnp.zeros(1), jnp.zeros(1)
    return jax.jacobian(lambda y: jnp.concatenate(jax.tree.leaves(observer.flow(jnp.zeros(()), z, u, y))))(y)


@PAPER.claim("(37) (40) bounded form", "identity", printed="xi_1 - xi_hat_1 is what is injected", long=True)
def _():
    """With eps = xi - xi_hat the same observer without growing states: equal up to rounding."""
    end = 5.0
    printed = AsPrinted(Pendulum(), C4, experiment.GAMMA, Q)
    gap = np.abs(
        np.asarray(experiment.run(printed, noisy=True, end=end).xhat)
        - experiment.run(experiment.integral(), noisy=True, end=end).xhat
    )
    return Statement(
        bool(gap.max() < 1e-9), float(gap.max()), f"largest difference of the estimates over {end:g} s, with noise, float64"
    )


@PAPER.claim("(37) growth", "universal", printed="the exact q-th integral of y can be fed back", long=True)
def _():
    """xi_1 after 200 s and what float32 makes of it, beside the bounded form."""
    end, after = 200.0, 100.0
    single, rms, largest = jnp.float32, [], 0.0
    for observer in (AsPrinted(Pendulum(), C4, experiment.GAMMA, Q), experiment.integral()):
        pair = [_without_noise(part, end) for part in (observer, astype(observer, single))]
        late = np.arange(pair[0][0].shape[0]) * experiment.PERIOD >= after
        rms.append(float(np.sqrt(np.mean((pair[0][0] - pair[1][0])[late, 1] ** 2))))
        largest = largest or float(np.max(np.abs(_twice_integrated(pair[0][1]))))
    why = (
        "in exact arithmetic yes, see the row above; in floats not for long: (37) is unstable with y as input, xi_1 reaches "
        f"{largest:.3g} after {end:g} s (gamma = 6, q = 2), and float32 loses {rms[0]:.2g} RMS in x_2 over the second half, "
        f"{rms[1]:.1g} in the equivalent form in xi - xi_hat, which stays bounded"
    )
    return Statement(rms[0] < 10 * rms[1], largest, why)


def _without_noise(observer: AbstractFlowObserver, end: float) -> tuple[np.ndarray, np.ndarray]:
    """(x - xhat, y), along the pendulum in the observer's own precision."""
    path = experiment.run(observer, end=end)
    return np.asarray(path.x - path.xhat, float), np.asarray(path.y, float)[:, 0]


def _twice_integrated(y: np.ndarray) -> np.ndarray:
    inner = np.cumsum(y) * experiment.PERIOD
    return np.cumsum(inner) * experiment.PERIOD
