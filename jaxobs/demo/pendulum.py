"""The pendulum of paper 000: condition (5), the experiments of figures 1 and 3, and a Monte Carlo study of gamma and q."""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import hurwitz, linalg
from jaxobs._simulate import Trajectory
from jaxobs.certificates import Condition5, Verdict
from jaxobs.designs import riccati
from jaxobs.observers import HighGain, IntegralHighGain
from jaxobs.papers.p000 import experiment
from jaxobs.papers.p000.experiment import PERIOD, RHO, SIGMA
from jaxobs.plants import Pendulum
from jaxobs.studies import grid
from jaxobs.tuning import settling_time


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
    plain, certificate = riccati(Pendulum(), alphas=experiment.ALPHAS, gamma=experiment.GAMMA, lipschitz=RHO)
    verdict = certificate.verify()
    figure1, figure3_plain = experiment.run(plain), experiment.run(plain, noisy=True)
    figure3 = experiment.run(experiment.integral(), noisy=True)
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
    # e_x2 from e_x1(0) = 1, at gamma = 1, phi left out.
    settling = float(settling_time(alphas, q, start=1))
    return Sweep(name, gammas, experiment.rmse_of_x2(grid(observer, gamma=gammas), seeds), c, settling)
