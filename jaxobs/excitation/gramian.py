"""Observability Gramians along an input, as square roots, on the host in float64.

phi(s, t) is the transition matrix of x' = A(u) x. Two Gramians at time t (paper 003, (11) and (21)):

    G(t, theta)   = int_{t - 1/theta}^t phi(s,t)'C'C phi(s,t) ds,
    Psi(t, theta) = int_0^t e^{-theta (t-s)} phi(s,t)'C'C phi(s,t) ds.

phi is taken backwards from t by Gauss collocation at 5 nodes a panel, of order 10 (exact on chains of integrators with up to 5
states), Psi is carried from panel to panel by QR array steps with the scale of each column kept as a logarithm, so that neither
a small eigenvalue nor e^{-theta t} underflows.
"""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxobs._module import dtype_of, refuse
from jaxobs.plants import AbstractBlockTriangular, AbstractFlowPlant
from jaxobs.signals import AbstractSignal

Inputs = Callable[[np.ndarray], Array]  # times (k,) -> u (k, m)


def _gauss(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes, weights and the collocation matrix a_ij = int_0^{c_i} l_j of Gauss-Legendre on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(count)
    nodes = (x + 1) / 2
    powers = np.vander(nodes, count, increasing=True)
    integrals = powers * nodes[:, None] / np.arange(1, count + 1)
    return nodes, w / 2, integrals @ np.linalg.inv(powers)


NODES, WEIGHTS, COLLOCATION = _gauss(5)


@dataclasses.dataclass(frozen=True)
class Pair:
    """(A(u(t)), C) of a plant along an input, and the sizes of the blocks of states that Delta = diag(theta^i) counts."""

    plant: AbstractFlowPlant
    inputs: Inputs
    blocks: tuple[int, ...]

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A (..., n, n) and C (p, n) at an array of times."""
        flat = np.asarray(times, float).reshape(-1)
        padded = np.full(2 ** int(np.ceil(np.log2(max(len(flat), 256)))), flat[-1])  # few shapes, few compilations
        padded[: len(flat)] = flat
        a, c = _evaluate(self.plant, self.inputs(padded))
        n = a.shape[-1]
        return np.asarray(a, float)[: len(flat)].reshape(*np.shape(times), n, n), np.asarray(c, float)[0]

    @property
    def powers(self) -> np.ndarray:
        """1, ..., 1, 2, ..., 2, ...: the number of its block, for each state."""
        return np.repeat(np.arange(1, len(self.blocks) + 1), self.blocks)


@eqx.filter_jit
def _evaluate(plant: Any, us: Array) -> tuple[Array, Array]:
    return jax.vmap(plant.pair)(us)


@eqx.filter_jit
def _values(signal: AbstractSignal, times: Array) -> Array:
    return jax.vmap(signal)(times)


def pair_of(owner: str, plant: AbstractFlowPlant, u: AbstractSignal | Callable[[float], Any]) -> Pair:
    """ValueError for a plant without (A(u), C), with several outputs but no blocks, or an input of another size."""
    if not hasattr(plant, "pair"):
        fix = "Write it as a subclass of AbstractTriangular, AbstractBlockTriangular or AbstractStateAffine."
        raise refuse(owner, "plant", type(plant).__name__, "a plant with pair(u) -> (A(u), C)", fix)
    if isinstance(plant, AbstractBlockTriangular):
        blocks = tuple(plant.blocks)
    elif plant.p == 1:
        blocks = (1,) * plant.n
    else:
        fix = "Order the states into blocks: AbstractBlockTriangular."
        raise refuse(owner, "plant", f"p = {plant.p} outputs without blocks", "p = 1, or a block form", fix)

    dtype = dtype_of(plant, u)

    def inputs(times: np.ndarray) -> Array:
        if isinstance(u, AbstractSignal):
            return _values(u, jnp.asarray(times, dtype))
        known, place = np.unique(times, return_inverse=True)
        return jnp.asarray(np.asarray([np.reshape(u(float(t)), -1) for t in known], float)[place], dtype)

    shape = inputs(np.zeros(1)).shape
    if shape != (1, plant.m):
        fix = "u(t) gives one number for each input of the plant."
        raise refuse(owner, "u", f"values of shape {shape[1:]}", f"shape ({plant.m},)", fix)
    return Pair(plant, inputs, blocks)


def _panels(pair: Pair, ends: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """In [end - length, end]: rows C phi(s_i, end) (k, nodes, p, n), phi(start, end) (k, n, n), ages end - s_i (k, nodes)."""
    ages = lengths[:, None] * NODES
    a, c = pair.at(ends[:, None] - ages)
    count, n = len(ends), a.shape[-1]
    # X_i = I - length sum_j a_ij A_j X_j, stacked over the nodes.
    coupling = np.einsum("ij,kjab,k->kiajb", COLLOCATION, a, lengths).reshape(count, len(NODES) * n, len(NODES) * n)
    right = np.tile(np.eye(n), (len(NODES), 1))
    x = np.linalg.solve(np.eye(len(NODES) * n) + coupling, right).reshape(count, len(NODES), n, n)
    through = np.eye(n) - np.einsum("j,kjab,kjbc,k->kac", WEIGHTS, a, x, lengths)
    return c @ x, through, ages


@dataclasses.dataclass(frozen=True)
class Gramians:
    """Gramians at times (k,) for rates thetas (r,) by their roots: D M'M D with M = roots (k, r, n, n), D = diag(e^logs)."""

    times: np.ndarray
    thetas: np.ndarray
    roots: np.ndarray
    logs: np.ndarray
    blocks: tuple[int, ...]

    def full(self) -> np.ndarray:
        """The Gramians themselves, (k, r, n, n); entries below the floats are 0."""
        scaled = self.roots * np.exp(self.logs)[..., None, :]
        return np.swapaxes(scaled, -1, -2) @ scaled

    def smallest(self, graded: np.ndarray | None = None) -> np.ndarray:
        """lambda_min of W Gramian W, (k, r), W = diag(graded) (r, n) or the identity."""
        scaled = self.roots * np.exp(self.logs)[..., None, :]
        if graded is not None:
            scaled = scaled * graded[..., None, :]
        return np.linalg.svd(scaled, compute_uv=False)[..., -1] ** 2

    def coupling(self) -> np.ndarray:
        """The least alpha with Gamma <= alpha Gramian, (k, r): Gamma its block diagonal. Infinite where Gamma is singular."""
        parts, edges = [], np.cumsum([0, *self.blocks])
        regular = np.ones(self.roots.shape[:2], bool)
        for begin, end in itertools.pairwise(edges):
            q, r = np.linalg.qr(self.roots[..., begin:end])
            diagonal = np.abs(np.diagonal(r, axis1=-2, axis2=-1))
            scale = np.linalg.norm(self.roots[..., begin:end], axis=(-2, -1))
            regular &= np.all(diagonal > 1e-14 * scale[..., None], axis=-1) & (scale > 0)
            parts.append(q)
        smallest = np.linalg.svd(np.concatenate(parts, axis=-1), compute_uv=False)[..., -1]
        with np.errstate(divide="ignore"):
            return np.where(regular & (smallest > 1e-15), 1 / smallest**2, np.inf)

    def spread(self) -> np.ndarray:
        """max over j <= i of |Gamma_jj^-1| |Gamma_ii|, (k, r): infinite where Gamma is singular."""
        edges = np.cumsum([0, *self.blocks])
        large, small = [], []
        for begin, end in itertools.pairwise(edges):
            logs = self.logs[..., begin:end]
            top = np.max(logs, axis=-1)
            finite = np.where(np.isfinite(top), top, 0)
            values = np.linalg.svd(
                self.roots[..., begin:end] * np.exp(logs - finite[..., None])[..., None, :], compute_uv=False
            )
            with np.errstate(divide="ignore"):
                large.append(finite + np.log(values[..., 0]))
                small.append(finite + np.log(values[..., -1]))
        with np.errstate(invalid="ignore", over="ignore"):
            pairs = [large[i] - small[j] for i in range(len(large)) for j in range(i + 1)]
            return np.nan_to_num(np.exp(2 * np.max(pairs, axis=0)), nan=np.inf)


def fading_gramians(
    pair: Pair, grid: np.ndarray, thetas: np.ndarray, start: tuple[np.ndarray, np.ndarray] | None = None
) -> Gramians:
    """Psi(t, theta) on the grid, t_0 = grid[0]: from zero there, or from the root `start` of an earlier Gramian,

        Psi(t) = e^{-theta (t-t_0)} phi(t_0,t)'Psi(t_0) phi(t_0,t) + int_{t_0}^t e^{-theta (t-s)} phi(s,t)'C'C phi(s,t) ds.

    grid (k,) [s], increasing, one panel between two neighbours; thetas (r,) [1/s]; start: (M (r, n, n), logs (r, n)), where
    Psi(t_0) = D M'M D, D = diag(e^logs). Returns the roots at all grid times, t_0 included. Nothing is checked. Source: paper
    003, (21); the array step: Kailath, Sayed and Hassibi, Linear Estimation, 2000, chapter 12.
    """
    ends, lengths = grid[1:], np.diff(grid)
    rows, through, ages = _panels(pair, ends, lengths)
    n, rates = through.shape[-1], len(thetas)
    root, logs = start or (np.zeros((rates, n, n)), np.full((rates, n), -np.inf))
    roots, all_logs = [root], [logs]
    weight = np.sqrt(np.outer(lengths, WEIGHTS))[:, None] * np.exp(-thetas[:, None] * ages[:, None] / 2)  # (k, r, nodes)
    for k in range(len(ends)):
        fresh = (weight[k][:, :, None, None] * rows[k]).reshape(rates, -1, n)
        root, logs = _array_step(root, logs - thetas[:, None] * lengths[k] / 2, through[k], fresh)
        roots.append(root)
        all_logs.append(logs)
    return Gramians(grid, thetas, np.stack(roots), np.stack(all_logs), pair.blocks)


def _array_step(root, logs, through, fresh) -> tuple[np.ndarray, np.ndarray]:
    """The root of through' Gramian through + fresh'fresh, its columns scaled to norm 1, with the logarithms of the scales."""
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(through != 0, logs[..., :, None] + np.log(np.abs(through)), -np.inf)  # (r, i, j)
        own = np.log(np.max(np.abs(fresh), axis=-2))
        top = np.maximum(np.max(reach, axis=-2), own)
        shift = np.where(np.isfinite(top), top, 0)
        carried = root @ (np.sign(through) * np.exp(reach - shift[..., None, :]))
        # e^{log - shift} of the new rows, entry by entry, so that a large shift cannot make 0 * inf
        rows = np.sign(fresh) * np.exp(np.log(np.abs(fresh)) - shift[..., None, :])
    r = np.linalg.qr(np.concatenate([carried, rows], axis=-2), mode="r")
    norm = np.linalg.norm(r, axis=-2)
    with np.errstate(divide="ignore"):
        return r / np.where(norm > 0, norm, 1)[..., None, :], np.where(norm > 0, shift + np.log(norm), -np.inf)


def window_gramians(pair: Pair, times: np.ndarray, theta: float, breaks: np.ndarray, panels: int = 4) -> Gramians:
    """G(t, theta) = int_{t - 1/theta}^t phi(s,t)'C'C phi(s,t) ds, the windows cut at the breaks.

    times (k,) [s]; theta [1/s], one number; breaks (b,) [s], any, () if none: those inside a window cut its `panels` equal
    panels. Returns the roots for r = 1. Nothing is checked: the input is asked from t - 1/theta on. Source: paper 003, (11).
    """
    even = times[:, None] - np.arange(panels + 1)[::-1] / (panels * theta)
    cuts = np.clip(np.broadcast_to(breaks, (len(times), len(breaks))), even[:, :1], even[:, -1:])
    edges = np.sort(np.concatenate([even, cuts], axis=1), axis=1)
    n = len(pair.powers)
    back = np.broadcast_to(np.eye(n), (len(times), n, n))
    stack = []
    for j in range(edges.shape[1] - 1, 0, -1):
        lengths = edges[:, j] - edges[:, j - 1]
        if np.any(lengths > 0):
            rows, through, _ = _panels(pair, edges[:, j], lengths)
            weight = np.sqrt(np.outer(lengths, WEIGHTS))[:, :, None, None]
            stack.append((weight * rows @ back[:, None]).reshape(len(times), -1, n))
            back = through @ back
    r = np.asarray(np.linalg.qr(np.concatenate(stack, axis=1), mode="r"))
    return Gramians(times, np.asarray([theta]), r[:, None], np.zeros((len(times), 1, n)), pair.blocks)
