"""From a plant x' = A x + B f(x) + g(y, u) and bounds on the slopes of f to the error dynamics of its observer.

The mean value theorem, entry by entry, or an exact identity, writes f(x) - f(z) as bounded channels times x - z: paper 004,
(2), (5), (11), (15).
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of, refuse, require_instance
from jaxobs.designs.polytope import Polytope
from jaxobs.integrators import Euler
from jaxobs.plants import AbstractChain, AbstractFlowPlant, AbstractLipschitz, Discretised, Saturated

GIVEN = "given, not proved"
SIMULATED = "conditional: the extremes of a simulation, which proves nothing beyond it"
TRIALS = 8  # points at which the structure is compared with the Jacobian


@dataclasses.dataclass(frozen=True)
class Channels:
    """f(x) - f(z) = sum_k rho_k left_k right_k' (x - z),   lower_k <= rho_k <= upper_k.

    left (q, r), its columns left_k; right (r, n), its rows; lower, upper (r,). tied (r,): channels with equal numbers have one
    rho; () if each has its own. origin: where the bounds come from; it becomes an assumption of the certificate. complete:
    whether it also says where the state and its estimate are, as that of `proved_channels` does.
    """

    left: np.ndarray
    right: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    tied: tuple[int, ...] = ()
    origin: str = GIVEN
    complete: bool = False

    def __post_init__(self):
        for name in ("left", "right", "lower", "upper"):
            object.__setattr__(self, name, np.array(getattr(self, name), float))
        r = self.lower.size
        object.__setattr__(self, "tied", tuple(self.tied) or tuple(range(r)))
        fits = {"left": (2, 1, r), "right": (2, 0, r), "lower": (1, 0, r), "upper": (1, 0, r)}
        for name, (rank, axis, size) in fits.items():
            value = getattr(self, name)
            if value.ndim != rank or value.shape[axis] != size:
                expected = f"{rank} axes, axis {axis} of length {r}"
                raise refuse("Channels", name, f"shape {value.shape}", expected, "One of everything for each channel.")
        if (crossed := np.flatnonzero(~(self.lower <= self.upper))).size:
            k = int(crossed[0])
            given = f"lower[{k}] = {self.lower[k]:.6g}, upper[{k}] = {self.upper[k]:.6g}"
            raise refuse("Channels", "lower", given, "lower <= upper", "Swap the two bounds.")


def slope_entries(lower: Any, upper: Any, *, origin: str = GIVEN) -> Channels:
    """Bounds on the entries of the Jacobian of f, both (q, n), as channels e_i e_j' (paper 004, (2)). Entries that are
    identically zero have the bounds 0, 0 and no corner."""
    low, high = np.array(lower, float), np.array(upper, float)
    if low.shape != high.shape or low.ndim != 2:
        fix = "One row a component of f, one column a state."
        raise refuse("slope_entries", "upper", f"shape {high.shape}", f"that of lower, {low.shape}, with two axes", fix)
    if (crossed := np.argwhere(~(low <= high))).size:
        i, j = map(int, crossed[0])
        given = f"lower[{i}, {j}] = {low[i, j]:.6g} and upper[{i}, {j}] = {high[i, j]:.6g}"
        raise refuse("slope_entries", "lower", given, "lower <= upper", "Swap the two bounds.")
    i, j = np.nonzero((low != 0) | (high != 0))
    return Channels(np.eye(len(low))[:, i], np.eye(low.shape[1])[j], low[i, j], high[i, j], origin=origin)


def midpoint_channels(plant: AbstractFlowPlant, lower: Any, upper: Any, *, origin: str | None = None) -> Channels:
    """For quadratic f and x, z in the box lower <= x <= upper (n,):  f(x) - f(z) = J((x + z) / 2) (x - z)  exactly,

    e.g. x1 x3 - z1 z3 = m3 e1 + m1 e3. The parameters are the coordinates m of the midpoint, at most n of them however many
    entries they enter: the Lorenz system has 2^3 corners instead of the 2^6 of (12). ValueError if f is not quadratic.
    """
    low, high = np.array(lower, float), np.array(upper, float)
    model = _flow_part(plant)
    at_zero, hessian = _jacobian(model, np.zeros(model.n)), np.asarray(jax.hessian(_f(model))(_point(model, np.zeros(model.n))))
    for x in _random_points(model.n):
        if not np.allclose(_jacobian(model, x), at_zero + hessian @ x, rtol=_tolerance(model), atol=_tolerance(model)):
            fix = "Give bounds on the entries of its Jacobian instead: slope_entries(lower, upper)."
            raise refuse("midpoint_channels", "plant", f"an f whose Jacobian is not affine, at x = {x}", "quadratic f", fix)
    q, n = at_zero.shape
    table = [(i, j, at_zero[i, j], at_zero[i, j], -1 - i * n - j) for i, j in np.argwhere(at_zero)]
    rows = [(i, j, low[k], high[k], hessian[i, j, k], k) for i, j, k in np.argwhere(hessian)]
    left = [np.eye(q)[i] for i, *_ in table] + [np.eye(q)[i] * slope for i, _, _, _, slope, _ in rows]
    right = [np.eye(n)[j] for _, j, *_ in table] + [np.eye(n)[j] for _, j, *_ in rows]
    bounds = [(a, b) for _, _, a, b, _ in table] + [(a, b) for _, _, a, b, _, _ in rows]
    tied = [k for *_, k in table] + [int(k) for *_, k in rows]
    box = f"conditional on the state and its estimate having their midpoint in {low.tolist()} .. {high.tolist()}"
    ends = np.reshape(bounds, (-1, 2)).T
    left, right = np.reshape(left, (-1, q)).T, np.reshape(right, (-1, n))
    return Channels(left, right, ends[0], ends[1], tuple(tied), origin or box)


def simulated_entries(plant: AbstractFlowPlant, xs: Any) -> Channels:
    """The extremes of the Jacobian's entries over the rows of xs (samples, n), as the paper takes them. They bound nothing
    outside the samples, and the mean values lie between x and the estimate: the certificate is labelled conditional."""
    model = _flow_part(plant)
    points = jnp.asarray(xs, dtype_of(model))
    if points.ndim != 2 or points.shape[1] != model.n:
        raise refuse("simulated_entries", "xs", f"shape {points.shape}", f"shape (samples, {model.n})", "One row a sample.")
    slopes = np.asarray(jax.jit(jax.vmap(jax.jacfwd(_f(model))))(points), float)
    return slope_entries(slopes.min(0), slopes.max(0), origin=SIMULATED)


def lpv_model(plant: Any, channels: Channels, *, inner: bool = False) -> Polytope:
    """The error dynamics e' = (A + sum_k rho_k B left_k right_k' - L C) e of the observer (10), or (15) for e+.

    plant in the form of paper 004 or a chain, or Discretised(plant, Euler(), T), for which it is I + T (...). inner: the
    observer puts the measurement into f (`InnerInjection`), which turns right_k' into right_k' (I - C^+ C): channels of
    measured states go. ValueError for channels that do not span the Jacobian of f, and under `Saturated` for bounds that
    exclude 0.
    """
    require_instance(
        "lpv_model",
        "channels",
        channels,
        Channels,
        "Make it with slope_entries(lower, upper), midpoint_channels or simulated_entries.",
    )
    model = _flow_part(plant)
    a, b, c = _matrices(model)
    if isinstance(model, Saturated):
        _require_saturation(channels)
    _require_structure(model, b, channels)
    left, right = b @ channels.left, channels.right
    if inner:
        right = right @ (np.eye(model.n) - np.linalg.pinv(c) @ c)
        right = np.where(np.abs(right) < 1e-12 * np.maximum(1.0, np.abs(channels.right).max(initial=0)), 0.0, right)
    kept = np.flatnonzero(np.any(right != 0, axis=1) & np.any(left != 0, axis=0))
    left, right = left[:, kept], right[kept]
    if isinstance(plant, Discretised):
        a, left = np.eye(model.n) + float(plant.dt) * a, float(plant.dt) * left
    tied = tuple(channels.tied[k] for k in kept)
    return Polytope(a, left, right, channels.lower[kept], channels.upper[kept], c, tied)


def _flow_part(plant: Any) -> AbstractLipschitz | AbstractChain:
    """The continuous plant whose f has the slopes."""
    if isinstance(plant, Discretised):
        if not (isinstance(plant.integrator, Euler) and plant.integrator.substeps == 1):
            given = f"{type(plant.integrator).__name__} with {getattr(plant.integrator, 'substeps', '?')} substeps"
            fix = "Other integrators nest f; (16) is about A x + B f(x)."
            raise refuse("lpv_model", "plant", given, "Euler(), one step", fix)
        plant = plant.plant
    fix = "Write it as x' = A x + B f(x) + g(y, u), y = C x: a subclass of AbstractLipschitz."
    require_instance("lpv_model", "plant", plant, AbstractLipschitz | AbstractChain, fix)
    return plant


def _f(model: Any):
    if isinstance(model, AbstractChain):
        return lambda x: model.phi(x, jnp.zeros((model.m,), x.dtype))[None]
    return model.f


def _matrices(model: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, B, C) in float64."""
    n = model.n
    if isinstance(model, AbstractChain):
        return np.eye(n, k=1), np.eye(n)[:, -1:], np.eye(1, n)
    a, b, c = (np.asarray(part, np.float64) for part in (model.a(), model.b(), model.c()))
    for name, value, shape in (("a", a, (n, n)), ("b", b, (n, b.shape[-1])), ("c", c, (model.p, n))):
        if value.shape != shape:
            fix = "It looks transposed." if value.shape == shape[::-1] else "Match the numbers of states and outputs."
            raise refuse(model, name, f"shape {value.shape}", f"shape {shape}", fix)
    return a, b, c


def _require_structure(model: Any, b: np.ndarray, channels: Channels) -> None:
    """The Jacobian of f, at random points, is a combination of the channels."""
    shape = (b.shape[1], model.n)
    for name, given in (("left", channels.left.shape[0]), ("right", channels.right.shape[1])):
        if given != shape[name == "right"]:
            fix = f"f has {shape[0]} components and x has {shape[1]}: bounds on its Jacobian have the shape {shape}."
            if (channels.left.shape[0], channels.right.shape[1]) == shape[::-1]:
                fix += " They look transposed."
            raise refuse("lpv_model", f"channels.{name}", f"size {given}", f"{shape[name == 'right']}", fix)
    names = sorted(set(channels.tied))
    units = np.zeros((len(names), shape[0] * shape[1]))
    for k, number in enumerate(channels.tied):
        units[names.index(number)] += np.outer(channels.left[:, k], channels.right[k]).ravel()
    for x in _random_points(model.n):
        slopes = _jacobian(model, x).ravel()
        rest = slopes - units.T @ np.linalg.lstsq(units.T, slopes, rcond=None)[0] if len(names) else slopes
        if np.max(np.abs(rest), initial=0) > _tolerance(model) * max(1.0, float(np.max(np.abs(slopes)))):
            i, j = divmod(int(np.argmax(np.abs(rest))), shape[1])
            slope = f"{slopes[i * shape[1] + j]:.3g} of f_{i + 1} along x_{j + 1}"
            given = f"no channel for the slope {slope}, at x = {np.round(x, 3)}"
            raise refuse("lpv_model", "channels", given, "channels that span the Jacobian of f", "Bound this entry too.")


def _require_saturation(channels: Channels) -> None:
    """sat multiplies the slope along x_j by something in [0, 1], independently for each j."""
    for k, (low, high) in enumerate(zip(channels.lower, channels.upper, strict=True)):
        if not low <= 0 <= high:
            fix = "Outside its box a saturated f is flat, so that 0 is a slope too: extend the bounds to it."
            raise refuse("lpv_model", "channels", f"bounds [{low:.6g}, {high:.6g}] of channel {k}", "bounds around 0", fix)
    columns = [tuple(np.flatnonzero(row)) for row in channels.right]
    groups = {number: {c for k, c in zip(channels.tied, columns, strict=True) if k == number} for number in channels.tied}
    if any(len(column) > 1 for column in columns) or any(len(found) > 1 for found in groups.values()):
        fix = "States saturate one by one: bound the entries one by one, slope_entries(lower, upper)."
        raise refuse("lpv_model", "channels", "a channel of several states", "channels of one state each", fix)


def _jacobian(model: Any, x: np.ndarray) -> np.ndarray:
    return np.asarray(jax.jacfwd(_f(model))(_point(model, x)), float)


def _point(model: Any, x: np.ndarray):
    return jnp.asarray(x, dtype_of(model))


def _tolerance(model: Any) -> float:
    return 1e3 * float(jnp.finfo(dtype_of(model)).eps)


def _random_points(n: int) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(TRIALS, n)) * 2.0 ** np.arange(TRIALS)[:, None] / 8
