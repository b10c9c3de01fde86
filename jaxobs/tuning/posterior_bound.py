"""The posterior Cramer-Rao bound: the floor under every estimator of a nonlinear plant."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._loop import Grid, as_state, require_parts, time_grid
from jaxobs._module import Numbers, check, dtype_of, key_axes, refuse, require_shape
from jaxobs.integrators import RK4, AbstractIntegrator, Field
from jaxobs.plants import AbstractFlowPlant, AbstractPlant
from jaxobs.signals import AbstractSignal, Zero
from jaxobs.studies import Seeds

GROUPS = 20  # of trajectories, left out in turn: the jackknife
RANK = 1e-13  # n times this: eigenvalues of the correlations of the process noise below it are zero
LEAK = 1e-10  # of the random part of F outside the range of the process noise, relative to F


@dataclasses.dataclass(frozen=True, eq=False)
class PosteriorBound:
    """rmse (T, n) is the floor at each sample with its Monte Carlo standard_error, covariance (T, n, n) that of the bound.

    replicates (groups, T, n): the variances with one group of trajectories left out, from which the standard errors come.
    """

    ts: Float[np.ndarray, " T"]
    rmse: Float[np.ndarray, "T n"]
    standard_error: Float[np.ndarray, "T n"]
    covariance: Float[np.ndarray, "T n n"]
    replicates: Float[np.ndarray, "groups T n"]

    def over(self, after: float | int = 0.0) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The floor of the RMSE over t >= after, root of the mean over time of the variances, and its standard error."""
        late = self.ts >= after
        if not np.any(late):
            raise refuse("PosteriorBound.over", "after", after, f"at most {self.ts[-1]:.6g} s", "It is where the mean begins.")
        variances = np.diagonal(self.covariance, axis1=1, axis2=2)[late]
        floor = np.sqrt(np.mean(variances, axis=0))
        return floor, _jackknife(np.sqrt(np.mean(self.replicates[:, late], axis=1)))


def posterior_cramer_rao(
    plant: AbstractPlant,
    *,
    ts: Numbers,
    x0_mean: Numbers,
    x0_covariance: Numbers,
    noise_covariance: Numbers,
    process_covariance: Numbers,
    keys: Any,
    signal: AbstractSignal | None = None,
    integrator: AbstractIntegrator | None = None,
) -> PosteriorBound:
    """The least covariance P_k of the error of any estimator of x_k from y_0, ..., y_k, biased or not, nonlinear or not, for

        x_{k+1} = f(x_k) + w_k,   y_k = h(x_k) + v_k,   w ~ N(0, Q), v ~ N(0, R) white,  x_0 ~ N(x0_mean, x0_covariance),

    f one step of the plant by `integrator` without disturbance (that of a step plant is its own). With F = df/dx, H = dh/dx
    and all expectations over trajectories (one for each key), the recursion J_{k+1} = D22 - D21 (J_k + D11)^-1 D12 of the
    source is, by the matrix inversion lemma and with J_k = P_k^-1,

        P_{k+1}^- = Q + E[F] (P_k^-1 + V)^-1 E[F]',     V = E[(F - E F)'Q^-1 (F - E F)]
        P_{k+1}   = (P_{k+1}^-^-1 + M)^-1,              M = E[H'R^-1 H],

    computed without any inverse of P or Q. So x0_covariance may be singular, and Q too where every F - E F lies in its range:
    then V has the generalised inverse of Q and the recursion is that of the limit Q + eps I, eps -> 0 (what is not driven is
    then an affine function of what is, and the trajectory has a smooth density in those coordinates). Elsewhere the
    conditional density is singular along a curved set, no such bound exists, and Q is refused: a Q of full rank is that of
    white noise, `disturbance_covariance(plant, noise, dt, held=False)`. In a linear plant V = 0 and P is the Kalman filter's.

    ts (T,) evenly spaced. x0_mean (n,), x0_covariance (n, n) >= 0, noise_covariance R (p, p) > 0 of one sample,
    process_covariance Q (n, n) >= 0 of one step. keys: PRNG keys, or `jaxobs.Seeds`, two at least. Returns a `PosteriorBound`,
    whose standard errors are by the jackknife over groups of trajectories. It bounds the mean square over x_0, w and v
    together: compare with runs whose x_0 is drawn as here, or times at which x_0 is forgotten. It need not be attained.

    ValueError names the argument that does not fit, or the time at which a trajectory is not finite. Float64 is advised.
    Source: Tichavsky, Muravchik and Nehorai, IEEE Trans. Signal Processing 46 (1998) 1386, Proposition 1.
    """
    owner = "posterior_cramer_rao"
    signal = Zero(plant.m) if signal is None and isinstance(plant, AbstractPlant) else signal
    require_parts(owner, plant=plant, signal=signal, integrator=integrator)
    check(plant)
    if integrator is not None and not isinstance(plant, AbstractFlowPlant):
        raise refuse(owner, "integrator", type(integrator).__name__, "none for a step plant", "Leave it out.")
    if signal is not None and signal.m != plant.m:
        fix = "Give a signal with one component for each input."
        raise refuse(owner, "signal", f"m = {signal.m} inputs", f"the plant's m = {plant.m}", fix)
    dtype = dtype_of(plant)
    grid = time_grid(owner, ts, dtype, 1e-3)
    mean = as_state(owner, "x0_mean", x0_mean, plant.n, dtype)
    start = _roots(owner, "x0_covariance", x0_covariance, plant.n, "Of the first state about its mean.")
    driven = _roots(owner, "process_covariance", process_covariance, plant.n, "Of w_k, in one step.")
    noise = _roots(owner, "noise_covariance", noise_covariance, plant.p, "Of the noise of one sample.")
    if noise.rank < plant.p:
        given = np.asarray(noise_covariance).tolist()
        raise refuse(owner, "noise_covariance", given, "a positive definite matrix", "A sample without noise has no density.")
    count = _count(owner, keys)
    groups = min(GROUPS, count)
    step = RK4() if integrator is None else integrator
    found = _recursion(plant, signal, step, grid, mean, (start, driven, noise), keys, count, groups)
    all_p, finite, leak = (np.asarray(one) for one in found)
    if not np.all(finite):
        time = float(grid.ts[int(np.argmin(finite))])
        fix = "The bound needs trajectories that stay finite: shorten ts, or keep the start where the plant is stable."
        raise refuse(owner, "x0_mean", f"trajectories that are not finite at t = {time:.6g} s", "finite trajectories", fix)
    if float(np.max(leak)) > LEAK:
        given = f"rank {driven.rank} of {plant.n}, while the Jacobian of the step varies outside its range"
        fix = "Take that of white noise: disturbance_covariance(plant, noise, dt, held=False)."
        raise refuse(owner, "process_covariance", given, "a range that holds all of F - E F, e.g. full rank", fix)
    variances = np.maximum(np.diagonal(all_p, axis1=2, axis2=3), 0)
    replicates = np.swapaxes(variances[:, 1:], 0, 1)
    error = _jackknife(np.sqrt(replicates))
    return PosteriorBound(np.asarray(grid.ts), np.sqrt(variances[:, 0]), error, all_p[:, 0], replicates)


class Roots(NamedTuple):
    """Of a covariance Q: root root' = Q, white Q white' = the identity on rank(Q) rows, zero on the others, unseen Q = 0."""

    root: Float[np.ndarray | Array, "n n"]
    white: Float[np.ndarray | Array, "n n"]
    unseen: Float[np.ndarray | Array, "n n"]

    @property
    def rank(self) -> int:
        return int(np.sum(np.any(np.asarray(self.white) != 0, axis=1)))


@eqx.filter_jit
def _recursion(
    plant: Any,
    signal: Any,
    integrator: AbstractIntegrator,
    grid: Grid,
    mean: Float[Array, " n"],
    numbers: tuple[Roots, Roots, Roots],
    keys: Any,
    count: int,
    groups: int,
) -> tuple[Array, Array, Array]:
    """P (T, 1 + groups, n, n): from all trajectories, and with each group left out; which times are finite; the leaks."""
    n, dtype = plant.n, mean.dtype
    start, driven, noise = (jax.tree.map(lambda one: one.astype(dtype), roots) for roots in numbers)
    group = jnp.arange(count) * groups // count
    own = jax.vmap(lambda i: keys[i])(jnp.arange(count))
    sizes = jax.ops.segment_sum(jnp.ones((count,), dtype), group, groups)
    rest = (count - jnp.concatenate([jnp.zeros((1,), dtype), sizes]))[:, None, None]
    one = jnp.eye(n, dtype=dtype)

    def left_out(values):
        """Sums over all trajectories, and over all but those of each group."""
        sums = jax.ops.segment_sum(values, group, groups)
        return jnp.sum(sums, axis=0) - jnp.concatenate([jnp.zeros_like(sums[:1]), sums])

    def seen(x, t):
        h = noise.white @ jax.jacfwd(lambda x: plant.h(x, signal(t)))(x)
        return h.T @ h

    split = getattr(plant, "split", None)
    field = Field(lambda t, x: plant.flow(t, x, signal(t)), split and (lambda t, x: split(t, x, signal(t))))
    flows = isinstance(plant, AbstractFlowPlant)
    cache = integrator.prepare(field, grid.spacing, mean) if flows else None

    def ahead(x, k, t):
        return integrator.step(field, cache, t, grid.spacing, x) if flows else plant.step(k, x, signal(t))

    def tick(carry, sample):
        (x, p), (k, t) = carry, sample
        # What is random in x_k: x_0 about its mean, later the noise of the step that led here.
        w = jax.vmap(lambda key: jax.random.normal(jax.random.fold_in(key, k), (n,), dtype))(own)
        x = x + w @ jnp.where(k == 0, start.root, driven.root).T
        m = left_out(jax.vmap(lambda x: seen(x, t))(x)) / rest
        p = _symmetric(jnp.linalg.solve(one + p @ m, p))
        f, after = jax.vmap(jax.jacfwd(lambda x: (ahead(x, k, t),) * 2, has_aux=True))(x)
        average = jnp.mean(f, axis=0)
        random = f - average
        parts = driven.white @ random
        shift = left_out(random) / rest
        spread = left_out(jnp.swapaxes(parts, 1, 2) @ parts) / rest
        moved = driven.white @ shift
        v = spread - jnp.swapaxes(moved, 1, 2) @ moved
        size = jnp.max(jnp.abs(driven.unseen) @ jnp.abs(average), axis=1)
        outside = jnp.max(jnp.abs(driven.unseen @ random), axis=(0, 2))
        leak = jnp.max(jnp.where(outside > 0, outside / jnp.where(size > 0, size, 1), 0))
        mean_f = average + shift
        later = driven.root @ driven.root.T + mean_f @ jnp.linalg.solve(one + p @ v, p) @ jnp.swapaxes(mean_f, 1, 2)
        return (after, _symmetric(later)), (p, jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(f)), leak)

    state = jnp.broadcast_to(mean, (count, n)), jnp.broadcast_to(start.root @ start.root.T, (1 + groups, n, n))
    return jax.lax.scan(tick, state, (jnp.arange(grid.ts.shape[0]), grid.ts))[1]


def _symmetric(p: Float[Array, "g n n"]) -> Float[Array, "g n n"]:
    return (p + jnp.swapaxes(p, 1, 2)) / 2


def _roots(owner: str, name: str, value: Numbers, size: int, what: str) -> Roots:
    """The rank is that of the correlations, so that the sizes of the states do not matter."""
    a = np.array(value, np.float64)
    require_shape(owner, name, a, (size, size), what)
    if not np.all(np.isfinite(a)) or not np.allclose(a, a.T, rtol=1e-9, atol=0):
        raise refuse(owner, name, a.tolist(), "a finite symmetric matrix", what)
    variances = np.diagonal(a)
    scale = np.sqrt(np.where(variances > 0, variances, 1))  # a state that is not driven keeps its own unit
    values, vectors = np.linalg.eigh(a / np.outer(scale, scale))
    if np.min(values) < -1e-9 or np.min(variances) < 0:
        raise refuse(owner, name, a.tolist(), "a positive semidefinite matrix", what)
    kept = values > RANK * size
    sizes, inner = np.sqrt(np.where(kept, values, 1)), vectors.T / scale
    root = scale[:, None] * vectors * np.where(kept, sizes, 0)
    return Roots(root, np.where(kept, 1 / sizes, 0)[:, None] * inner, np.where(kept, 0, 1)[:, None] * inner)


def _count(owner: str, keys: Any) -> int:
    if not isinstance(keys, Seeds) and key_axes(keys) != 1:
        given = f"{type(keys).__name__} of shape {np.shape(keys)}"
        fix = "Split one key: jax.random.split(jax.random.key(0), 1000), or jaxobs.Seeds(jax.random.key(0), 1000)."
        raise refuse(owner, "keys", given, "PRNG keys along one axis", fix)
    if len(keys) < 2:
        raise refuse(owner, "keys", f"{len(keys)} of them", "two at least", "Each draws one trajectory; the more the surer.")
    return len(keys)


def _jackknife(replicates: Float[np.ndarray, "groups *s"]) -> Float[np.ndarray, "*s"]:
    """The standard error of an estimate from its values with each of the groups left out."""
    groups = len(replicates)
    return np.sqrt((groups - 1) / groups * np.sum((replicates - np.mean(replicates, axis=0)) ** 2, axis=0))
