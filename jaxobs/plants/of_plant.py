"""A plant read as one of the forms that designs ask for: the same equations, other methods.

`jaxobs.structure.forms(plant)` makes these, after it has proved the pattern for every x and u. A class here computes what is
specific to its form from the plant's own flow and output, so that the plant's parameters stay leaves. order: the states of the
form are x[order]; `to_normal` and `to_original` exchange the two. Made by hand, a class looks for a contradiction at one point
and proves nothing: parameters that are changed afterwards may take the form away, so that forms() has to be asked again.
"""

import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Module, concrete, dtype_of, float_leaves, refuse, require_instance, static
from jaxobs.plants.base import AbstractFlowPlant
from jaxobs.plants.forms import (
    AbstractBlockTriangular,
    AbstractChain,
    AbstractLipschitz,
    AbstractStateAffine,
    AbstractTriangular,
)

POINT = 0.7182818  # the point of a check: (POINT, POINT / 2, ...), where few expressions vanish by chance
FIX = "jaxobs.structure.forms(plant) says which forms a plant has."


class AbstractRead(Module):
    """n, m of the plant that is read as a form: a mixin, before the form among the bases."""

    plant: AbstractFlowPlant

    @property
    def n(self):
        return self.plant.n

    @property
    def m(self):
        return self.plant.m


class AbstractReordered(AbstractRead):
    """The same with the states in another order."""

    order: tuple[int, ...]

    def to_normal(self, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """The form's states of those of the plant."""
        return x[jnp.asarray(self.order)]

    def to_original(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """The plant's states of those of the form."""
        return z[jnp.asarray(np.argsort(self.order))]

    def moved(self, z: Float[Array, " n"], u: Float[Array, "*m"]) -> Float[Array, " n"]:
        """The plant's flow, as z'."""
        return self.to_normal(self.plant.flow(jnp.zeros((), z.dtype), self.to_original(z), u))


class ChainOf(AbstractReordered, AbstractChain):
    """z_i' = z_{i+1}, z_n' = phi(z, u), y = z_1 with z = x[order]: a plant that is a chain of integrators."""

    plant: AbstractFlowPlant
    order: tuple[int, ...] = static()

    def __check_init__(self):
        _require(self)

    def phi(self, x, u):
        return self.moved(x, u)[-1]


class TriangularOf(AbstractReordered, AbstractTriangular):
    """z_i' = a_i(u) z_{i+1} + g_i(u, z_1, ..., z_i), y = z_1 with z = x[order]; a_i(u) = dz_i'/dz_{i+1}."""

    plant: AbstractFlowPlant
    order: tuple[int, ...] = static()

    def __check_init__(self):
        _require(self)

    def a(self, u):
        zero = jnp.zeros((self.n,), dtype_of(self.plant, u))
        return jnp.diagonal(jax.jacfwd(lambda z: self.moved(z, u))(zero), offset=1)

    def g(self, x, u):
        """The flow without its couplings: g_i is taken at x_{i+1} = ... = x_n = 0, on which it does not depend."""
        known = jnp.tril(jnp.broadcast_to(x, (self.n, self.n)))
        return jnp.stack([self.moved(known[i], u)[i] for i in range(self.n)])


class BlockTriangularOf(AbstractReordered, AbstractBlockTriangular):
    """z_i' = A_i(u) z_{i+1} + g_i(u, z_1, ..., z_i) by blocks, y = z_1 with z = x[order]."""

    plant: AbstractFlowPlant
    order: tuple[int, ...] = static()
    blocks: tuple[int, ...] = static()

    def __check_init__(self):
        _require(self)

    def a(self, u):
        zero = jnp.zeros((self.n,), dtype_of(self.plant, u))
        jacobian = jax.jacfwd(lambda z: self.moved(z, u))(zero)
        edges = [0, *itertools.accumulate(self.blocks)]
        return tuple(jacobian[i:j, j:k] for i, j, k in zip(edges, edges[1:], edges[2:], strict=False))

    def g(self, x, u):
        edges = [0, *itertools.accumulate(self.blocks)]
        parts = [self.moved(x.at[j:].set(0), u)[i:j] for i, j in itertools.pairwise(edges)]
        return jnp.concatenate(parts)


class StateAffineOf(AbstractRead, AbstractStateAffine):
    """x' = A(u) x + b(u), y = C x: a plant that is affine in its state."""

    def __check_init__(self):
        _require(self)

    @property
    def p(self):
        return self.plant.p

    def a(self, u):
        t, zero = jnp.zeros((), u.dtype), jnp.zeros((self.n,), u.dtype)
        return jax.jacfwd(lambda x: self.plant.flow(t, x, u))(zero)

    def b(self, u):
        return self.plant.flow(jnp.zeros((), u.dtype), jnp.zeros((self.n,), u.dtype), u)

    def c(self):
        return output_matrix(self.plant)


class LipschitzOf(AbstractRead, AbstractLipschitz):
    """x' = A x + B f(x) + g(y, u), y = C x: a plant whose inputs meet measured states only.

    rows: the components of the flow that are nonlinear in a state which is not measured; f holds these, without their linear
    part. measured: for each output its state if C picks states, else empty. With x_y the measured states alone, every other
    component is A x + g(y, u) with g = flow(x_y, u), and in `rows` g(y, u) = flow(x_y, u) - flow(x_y, 0). A holds the constant
    entries of df/dx that are not in g; entries: which these are, (row, column).
    """

    rows: tuple[int, ...] = static()
    measured: tuple[int, ...] = static()
    entries: tuple[tuple[int, int], ...] = static()

    def __check_init__(self):
        _require(self)

    @property
    def p(self):
        return self.plant.p

    def a(self):
        dtype = dtype_of(self.plant)
        zero, none = jnp.zeros((self.n,), dtype), jnp.zeros((self.m,), dtype)
        jacobian = jax.jacfwd(lambda x: self.plant.flow(jnp.zeros((), dtype), x, none))(zero)
        mask = np.zeros((self.n, self.n), bool)
        mask[tuple(np.reshape(self.entries, (-1, 2)).astype(int).T)] = True
        return jnp.where(mask, jacobian, jnp.zeros_like(jacobian))

    def b(self):
        return jnp.eye(self.n, dtype=dtype_of(self.plant))[:, np.asarray(self.rows, int)]

    def c(self):
        return output_matrix(self.plant)

    def f(self, x):
        none = jnp.zeros((self.m,), x.dtype)
        varying = self.plant.flow(jnp.zeros((), x.dtype), x, none) - self.a().astype(x.dtype) @ x
        return varying[np.asarray(self.rows, int)]

    def g(self, y, u):
        x = jnp.zeros((self.n,), y.dtype)
        if self.measured:
            x = x.at[np.asarray(self.measured)].set(y)
        t, own = jnp.zeros((), y.dtype), np.zeros(self.n, bool)
        own[list(self.rows)] = True
        driven = self.plant.flow(t, x, u)
        rest = self.plant.flow(t, x, jnp.zeros_like(u))
        return driven - jnp.where(own, rest, self.a().astype(y.dtype) @ x)


def output_matrix(plant: AbstractFlowPlant) -> Float[Array, "p n"]:
    """C of a linear output: its slope."""
    dtype = dtype_of(plant)
    return jax.jacfwd(plant.h)(jnp.zeros((plant.n,), dtype), jnp.zeros((plant.m,), dtype))


def _require(form: Any) -> None:
    """ValueError where the form's flow or output differs from the plant's at one point."""
    plant, order = form.plant, getattr(form, "order", None)
    require_instance(form, "plant", plant, AbstractFlowPlant, "Build it first; the forms are those of flow plants.")
    if order is not None and sorted(order) != list(range(plant.n)):
        fix = "order[i] is the number of the plant's state that becomes the i-th, from 0."
        raise refuse(form, "order", order, f"each of 0 to {plant.n - 1} once", fix)
    if any(concrete(leaf) is None for leaf in float_leaves(plant)):
        return
    own, mine = _both(form)
    for name in own:
        theirs, ours = np.asarray(own[name]), np.asarray(mine[name])
        scale = 1.0 + float(np.max(np.abs(theirs), initial=0.0))
        if ours.shape != theirs.shape or not np.all(np.abs(ours - theirs) <= 1e3 * np.finfo(theirs.dtype).eps * scale):
            given = f"{type(plant).__name__}, whose {name} is {theirs} at one point, where the form has {ours}"
            raise refuse(form, "plant", given, "a plant of this form", FIX)


@eqx.filter_jit
def _both(form: Any) -> tuple[dict[str, Array], dict[str, Array]]:
    """Flow and output of the plant, and of the form, at one point."""
    plant = form.plant
    dtype = dtype_of(plant)
    x = jnp.asarray(POINT / np.arange(1, plant.n + 1), dtype)
    u = jnp.asarray(POINT / np.arange(2, plant.m + 2), dtype)
    t, forward = jnp.zeros((), dtype), getattr(form, "to_normal", lambda x: x)
    own = {"flow": forward(plant.flow(t, x, u)), "h": plant.h(x, u)}
    return own, {"flow": form.flow(t, forward(x), u), "h": form.h(forward(x), u)}
