"""How the equation of S behaves in floats: what the paper leaves to whoever computes it. Rows of ours."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs.excitation import fading_gramians
from jaxobs.excitation.gramian import pair_of
from jaxobs.integrators import RK4, Field
from jaxobs.observers import StepLyapunov
from jaxobs.papers.claims import OURS, Statement
from jaxobs.papers.p003.paper import PAPER
from jaxobs.plants import GatedChain, IntegratorChain


@PAPER.claim("cond(S) is grading", "figure", printed=OURS)
def _():
    shown, spread, worst = [], 0.0, 0.0
    for n in (2, 3, 5):
        pair, conds = pair_of("p003", IntegratorChain(n), lambda t: np.zeros(0)), []
        for theta in (10.0, 100.0):
            gramians = fading_gramians(pair, np.linspace(0, 100 / theta, 801), np.asarray([theta]))
            root = gramians.roots[-1, 0]  # columns of norm 1: the factor of S scaled to a unit diagonal
            conds.append([np.linalg.cond(root * np.exp(log)) ** 2 for log in (gramians.logs[-1, 0], np.zeros(n))])
        (_, first), (raw, worst) = conds
        spread = max(spread, abs(first / worst - 1))
        shown.append(f"{raw:.2g} and {worst:.3g} for n = {n}")
    why = (
        f"steady S of a chain: cond(S) at theta = 100 as it is, and with its diagonal scaled to 1: {'; '.join(shown)}. The "
        f"scaled one does not depend on theta (to {spread:.1g}); ours is that of n = 5"
    )
    return Statement(bool(spread < 1e-6), float(worst), why)


@PAPER.claim("explicit steps on S", "figure", printed=OURS)
def _():
    @jax.jit
    def growth(step):
        """|S| after 200 steps of RK4 on s' = -s."""
        field = Field(lambda t, s: -s)
        return jnp.abs(jax.lax.fori_loop(0, 200, lambda k, s: RK4().step(field, None, step, step, s), jnp.ones_like(step)))

    low, high = 2.0, 3.5
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (middle, high) if float(growth(jnp.asarray(middle))) < 1 else (low, middle)
    why = "the largest theta dt at which RK4 keeps S bounded: all eigenvalues of its equation are -theta for nilpotent A(u)"
    return Statement(abs(low - (RK4.stability_limit or 0.0)) < 1e-3, low, why)


@PAPER.claim("P = S^-1 loses definiteness", "figure", printed=OURS, long=True)
def _():
    theta, dt, plant = 20.0, 0.02, GatedChain()
    us = np.where((np.arange(400) > 100) & (np.arange(400) < 300), 0.0, 1.0)  # a gap of 4 s, e^{-80} in S_22

    def of_p(p, u):
        a, c = plant.pair(u[None])
        field = Field(lambda t, p: theta * p + a @ p + p @ a.T - p @ c.T @ c @ p)
        p = RK4(substeps=20).step(field, None, jnp.zeros(()), jnp.asarray(dt), p)
        return p, jnp.linalg.eigvalsh((p + p.T) / 2)[0]

    observer = StepLyapunov(plant, jnp.asarray(theta), jnp.asarray(dt), jnp.eye(2))

    def of_root(z, u):
        z = observer.step(jnp.asarray(0), z, u[None], jnp.zeros(1))
        return z, jnp.min(jnp.diagonal(z[1]))

    smallest = np.asarray(jax.jit(lambda: jax.lax.scan(of_p, jnp.eye(2), jnp.asarray(us))[1])())
    pivots = np.asarray(jax.lax.scan(of_root, observer.init(jnp.zeros(2)), jnp.asarray(us))[1])
    bad = int(np.argmax(~(smallest > 0)))
    lost = bool(np.any(~(smallest > 0)))
    why = (
        f"theta = 20, u = 1 but 0 for t in [2, 6] s: P integrated by RK4 in steps of dt / 20 is no longer positive definite "
        f"from t = {bad * dt:.2f} s on; the root of S by array steps keeps pivots > 0 (ours: the smallest)"
    )
    return Statement(lost and bool(np.all(pivots > 0)), float(np.min(pivots)), why)


@PAPER.claim("no limit for array steps", "figure", printed=OURS, long=True)
def _():
    dt, plant = jnp.asarray(0.1), GatedChain()

    def error(product):
        observer, u = StepLyapunov(plant, product / dt, dt, jnp.eye(2)), jnp.ones(1)
        start = observer.init(jnp.asarray([1.0, 1.0]))  # a plant at rest in 0
        return jnp.max(jnp.abs(jax.lax.fori_loop(0, 20, lambda k, z: observer.step(k, z, u, jnp.zeros(1)), start)[0]))

    worst = float(jnp.max(jax.jit(jax.vmap(error))(jnp.asarray([1.0, 2.785, 10.0, 40.0]))))
    why = "|xhat - x| after 20 samples at most, theta dt = 1, 2.785, 10, 40: the step is exact, its weights are e^{-theta dt}"
    return Statement(worst < 1e-3, worst, why)
