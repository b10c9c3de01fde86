"""The pendulum of paper 000: condition (5), the experiments of figures 1 and 3, and a Monte Carlo study of gamma and q."""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxobs import hurwitz, linalg
from jaxobs._module import astype
from jaxobs._simulate import Trajectory, score, simulate
from jaxobs.certificates import Condition5, Verdict
from jaxobs.designs import riccati
from jaxobs.metrics import RMSE
from jaxobs.noise import Gaussian
from jaxobs.observers import HighGain, IntegralHighGain, Observer
from jaxobs.plants import Pendulum
from jaxobs.signals import Sine
from jaxobs.studies import grid, over

# The paper leaves noise and initial conditions open; these are ours.
SIGMA, PERIOD, AFTER, END = 0.1, 0.01, 10.0, 20.0
START, GUESS = [1.0, 0.0], [0.0, 0.0]
RHO = 1.5  # the paper's Lipschitz constant


class Sweep(NamedTuple):
    """RMSE of x2 over t >= 10 s, (gammas, seeds), of one structure; c of its noise law; its settling time at gamma = 1."""

    name: str
    gammas: np.ndarray
    rmse: np.ndarray
    c: float
    settling: float

    def law(self) -> np.ndarray:
        """sqrt(Var e_x2) = sigma sqrt(T_s gamma^3 c), for gamma T_s << 1."""
        return SIGMA * np.sqrt(PERIOD * self.gammas**3 * self.c)


class Pendulum000(NamedTuple):
    """Everything the demo shows of paper 000."""

    certificate: Condition5
    verdict: Verdict
    numbers: dict[str, float]
    figure1: Trajectory
    figure3: Trajectory
    figure3_plain: Trajectory
    sweeps: list[Sweep]


def study_pendulum(*, quick: bool = False, progress: Callable[[str], None] = lambda done: None) -> Pendulum000:
    """`quick` takes 8 gammas by 16 seeds instead of 64 by 256. The sweep is in float32, the rest in JAX's default precision."""
    plant = Pendulum()
    plain, certificate = riccati(plant, alphas=[3.0, 2.0], gamma=6.0, lipschitz=RHO)
    verdict = certificate.verify()
    ts = np.arange(0.0, END, PERIOD)

    def run(observer: Observer, noise: Gaussian | None) -> Trajectory:
        key = None if noise is None else jax.random.key(0)
        return simulate(plant, observer, x0=START, xhat0=GUESS, ts=ts, signal=_input(), noise=noise, key=key)

    figure1 = run(plain, None)
    integral = IntegralHighGain(plant, hurwitz.binomial(4), plain.gamma, 2)
    figure3, figure3_plain = run(integral, _noise()), run(plain, _noise())
    progress("figures 1 and 3")
    sweeps = []
    with ThreadPoolExecutor(2) as pool:  # XLA runs one such loop on one core
        for sweep in pool.map(lambda structure: _sweep(*structure, quick=quick), structures()):
            sweeps.append(sweep)
            progress(sweep.name)
    return Pendulum000(certificate, verdict, _numbers(plain), figure1, figure3, figure3_plain, sweeps)


def structures() -> list[tuple[str, jax.Array, int]]:
    """Name, alphas and q: the paper's gains, and binomial ones with q = 0, 1, 2."""
    own = jnp.asarray([3.0, 2.0], hurwitz.binomial(2).dtype)
    return [("q = 0, alphas (3, 2)", own, 0)] + [
        (f"q = {q}, alphas C({2 + q}, k)", hurwitz.binomial(2 + q), q) for q in range(3)
    ]


def _input() -> Sine:
    return Sine(amplitude=0.5)  # u = 0.5 sin t


def _noise() -> Gaussian:
    return Gaussian(SIGMA)


def _numbers(observer: HighGain | IntegralHighGain) -> dict[str, float]:
    """(71) and the smallest gamma, by the closed form."""
    bound = linalg.largest_lipschitz(observer.alphas, observer.gamma)
    p = linalg.chain_riccati(observer.alphas)
    root = jnp.sqrt(hurwitz.q_from_alphas(observer.alphas))
    slowest = observer.gamma / jnp.linalg.eigvalsh(p / jnp.outer(root, root))[-1]
    return {
        "lambda_min(P^-1/2 Q P^-1/2)": float(slowest),
        "2 sqrt((P^-1)_nn lambda_max(P))": float(slowest / bound),
        "largest certified Lipschitz constant": float(bound),
        "smallest gamma for rho = 3/2": float(linalg.smallest_gamma(observer.alphas, jnp.asarray(RHO, p.dtype))),
    }


def _sweep(name: str, alphas: jax.Array, q: int, *, quick: bool) -> Sweep:
    observer = HighGain(Pendulum(), alphas, 6.0) if q == 0 else IntegralHighGain(Pendulum(), alphas, 6.0, q)
    c = float(linalg.noise_covariance(alphas, q)[q + 1, q + 1])
    gammas, seeds = np.geomspace(2.0, 40.0, 8 if quick else 64), 16 if quick else 256
    single = jnp.float32
    plant, signal, noise = astype((Pendulum(), _input(), _noise()), single)
    metrics = {"rmse": astype(RMSE(AFTER), single)}
    ts = np.arange(0.0, END, PERIOD)

    def loss(observer, key):
        kept = score(plant, observer, metrics=metrics, x0=START, xhat0=GUESS, ts=ts, signal=signal, noise=noise, key=key)
        return kept["rmse"][1]

    table = over(grid(astype(observer, single), gamma=gammas), loss)(jax.random.split(jax.random.key(1), seeds))
    return Sweep(name, gammas, np.asarray(table, float), c, _settling(np.asarray(alphas), q))


def _settling(alphas: np.ndarray, q: int) -> float:
    """When |e_x2| stays below 5 % of its peak, at gamma = 1, from e_x1(0) = 1, phi left out: e' = (A - alphas C) e."""
    size = len(alphas)
    error_flow = np.eye(size, k=1)
    error_flow[:, 0] -= alphas
    period = 0.01
    step = scipy.linalg.expm(error_flow * period)
    e, path = np.eye(size)[q], []
    for _ in range(6000):
        path.append(abs(e[q + 1]))
        e = step @ e
    return float(period * (np.flatnonzero(np.asarray(path) > 0.05 * max(path))[-1] + 1))
