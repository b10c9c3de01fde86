"""The value of a semidefinite program as a differentiable function of what its matrices depend on.

    v(theta) = max_x f(x; theta)   subject to   F_i(x; theta) >= margin I,        or the largest common margin of the F_i,

    dv/dtheta = d/dtheta { f(x; theta) + sum_i <Z_i, F_i(x; theta) - margin I> }   at the optimal x and duals Z_i, both held.

Neither x nor Z is differentiated: the system of optimality conditions would have to be solved for that, which is singular
where one of them is not unique. The derivative exists where all optimal pairs give the same one, in particular where x and Z
are unique (both: a unique Z alone is not enough). Elsewhere v has one-sided derivatives, v'(theta; d) = max over x of min
over Z of the above along d, and what is returned belongs to the pair found: a supergradient of v where the Lagrangian is
concave in (x, theta), and between the one-sided derivatives of v where x alone, or Z alone, is not unique.

Source: Boyd and Vandenberghe, Convex Optimization, section 5.6 (the slope of v in the constraints is the dual); Gol'shtein,
Theory of Convex Programming, 1972 (one-sided derivatives; for x alone, Danskin's theorem).
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxobs._module import Scalar, concrete, refuse, require_finite, require_instance, require_positive
from jaxobs.designs import _optimality, sdp
from jaxobs.designs._optimality import ROUGH
from jaxobs.designs.sdp import Unknown

OWNER = "sdp_value"


@dataclasses.dataclass(frozen=True, eq=False)
class SdpProblem:
    """max f(x; theta):   F_i(x; theta) >= margin I for all i,   |x_j| <= reach_j;   without f: max t,   F_i(x; theta) >= t I.

        problem = SdpProblem({"p": sdp.symmetric(2, trace=2.0)}, lambda a, p: [p, -(a.T @ p + p @ a)])

    unknowns: by name, from `sdp.symmetric`, `full`, `scalar`; what is homogeneous needs a trace. lmis(theta, **unknowns): the
    symmetric F_i (k_i, k_i), in jax.numpy, affine in the unknowns, differentiable in theta. maximise(theta, **unknowns): f, an
    affine number. margin: in units of the F_i.
    """

    unknowns: Mapping[str, Unknown]
    lmis: Callable[..., Sequence[Any]]
    maximise: Callable[..., Any] | None = None
    margin: float = 0.0

    def __post_init__(self) -> None:
        require_instance(self, "unknowns", self.unknowns, Mapping, 'Write {"p": sdp.symmetric(n)}.')  # type: ignore[type-abstract]
        if not self.unknowns:
            raise refuse(self, "unknowns", "none", "one or more, by name", 'Write {"p": sdp.symmetric(n)}.')
        for name, unknown in self.unknowns.items():
            require_instance(self, f"unknowns[{name!r}]", unknown, Unknown, "Take sdp.symmetric, sdp.full or sdp.scalar.")
        for name, given in (("lmis", self.lmis), ("maximise", self.maximise)):
            if not (callable(given) or (name == "maximise" and given is None)):
                raise refuse(
                    self, name, type(given).__name__, f"a function {name}(theta, **unknowns)", "Give a function in jax.numpy."
                )
        require_finite(self, "margin", self.margin)
        if self.maximise is None and self.margin != 0:
            raise refuse(self, "margin", self.margin, "0 without maximise", "The margin itself is the value then.")
        if self.maximise is not None and not self.size:
            raise refuse(self, "unknowns", sorted(self.unknowns), "a free entry", "There is nothing to choose.")

    @property
    def size(self) -> int:
        """The number of free entries."""
        return len(sdp.reach_of(self.unknowns))

    def values(self, x: Array) -> dict[str, Array]:
        """The unknowns by name, from their free entries (size,)."""
        values, used = {}, 0
        for name, unknown in self.unknowns.items():
            own = x[used : used + len(unknown.basis)]
            values[name] = jnp.asarray(unknown.centre, x.dtype) + jnp.tensordot(own, jnp.asarray(unknown.basis, x.dtype), 1)
            used += len(unknown.basis)
        return values

    def inequalities(self, theta: Any, x: Array) -> tuple[list[Array], Array]:
        """(F_i (k_i, k_i), f ()) at the free entries x (size,); f = 0 without maximise."""
        values = self.values(x)
        matrices = [jnp.asarray(one) for one in self.lmis(theta, **values)]
        goal = jnp.zeros((), x.dtype) if self.maximise is None else jnp.asarray(self.maximise(theta, **values))
        return matrices, goal


class Optimum(NamedTuple):
    """value; gap: how far it may lie from the true one, by weak duality, what x violates included. error: the relative distance
    of the pair from one that satisfies the optimality conditions, by a step of Newton's method: so many digits has the
    gradient. margin: min_i lambda_min(F_i) at the unknowns. reached: max_j |x_j| / reach_j; at 1 the reach bounds the value.
    spread: how much the gradient changes, relative, with the pair, 0 <= spread <= 1, where that is not unique: v has a
    derivative where it is zero (some 1e-9), else one-sided ones. infeasible: no unknowns within reach satisfy F_i >= margin I,
    by duals. unknowns: by name. duals: Z_i >= 0 (k_i, k_i).
    """

    value: Scalar
    gap: Scalar
    error: Scalar
    margin: Scalar
    reached: Scalar
    spread: Scalar
    infeasible: Bool[Array, ""]
    unknowns: dict[str, Array]
    duals: tuple[Array, ...]


@dataclasses.dataclass(frozen=True, eq=False)
class SdpValue:
    """What `sdp_value` returns."""

    problem: SdpProblem
    tolerance: float

    def __call__(self, theta: Any) -> Scalar:
        """v(theta): under jit, vmap, grad and jvp; first derivatives only, a second one raises ValueError.

        -inf where no unknowns within reach satisfy F_i >= margin I, by duals. NaN where that is open and the solvers fail, the
        gap exceeds the tolerance, the pair has less than four digits, or a number is not finite. The gradient is NaN in all
        these cases. Functions that are not affine or not symmetric: ValueError, under jit and vmap NaN.
        """
        theta = jax.tree.map(_strong, theta)
        value = _value(self, theta)
        known = concrete(value)
        if known is not None and np.isnan(known):
            self._explain(theta)
        return value

    def solution(self, theta: Any) -> Optimum:
        """The value with its unknowns, duals and gap, under jit and vmap; its derivative is refused. NaN as the value is."""
        theta = jax.tree.map(_strong, theta)
        found = _solution(self, theta)
        known = concrete(found.value)
        if known is not None and np.any(np.isnan(known)):
            self._explain(theta)
        return found

    def _explain(self, theta: Any) -> None:
        """ValueError if the functions are what makes the value NaN."""
        skew, bent = _faults(self.problem, theta)
        if skew > ROUGH:
            fix = "Write both triangles: -(A.T @ p + p @ A), not -2 * p @ A."
            raise refuse(self.problem, "lmis", f"matrices with asymmetry {float(skew):.3g}", "symmetric ones", fix)
        if bent > ROUGH:
            fix = "Products of unknowns need other unknowns (y = p L), or a Schur complement."
            raise refuse(self.problem, "lmis or maximise", "a function not affine in the unknowns", "an affine one", fix)


def sdp_value(problem: SdpProblem, *, tolerance: float = 1e-8) -> SdpValue:
    """v with v(theta) the value of the program and jax.grad(v)(theta) its derivative, by the envelope theorem from the duals.

        v = sdp_value(SdpProblem({"p": sdp.symmetric(2, trace=2.0)}, lambda a, p: [p, -(a.T @ p + p @ a)]))
        slope = jax.grad(v)(a)

    theta: a pytree, its floats float64 (the program is solved in NumPy on the host; a mapped axis is solved one by one). A
    call takes one solve and a few singular value decompositions of size entries + sum_i k_i (k_i + 1) / 2: some 10 ms at size
    100, 0.3 s at 450.
    tolerance: the largest duality gap, relative to |v| + sum_i |Z_i| |F_i(0)|, at which a value is returned. ValueError for
    what does not fit.
    """
    require_instance(OWNER, "problem", problem, SdpProblem, "Give SdpProblem(unknowns, lmis).")
    require_positive(OWNER, "tolerance", tolerance, "It is a relative duality gap.")
    return SdpValue(problem, float(tolerance))


def _strong(leaf: Any) -> Any:
    """A number of a strong dtype, float64 if it is not an integer; what is no number as it is."""
    if not isinstance(leaf, (float, complex, np.ndarray, np.generic, jax.Array)):
        return leaf
    array = jnp.asarray(leaf)
    if not jnp.issubdtype(array.dtype, jnp.inexact):
        return array
    if jnp.finfo(array.dtype).bits != 64:
        fix = 'Convert it; jax.config.update("jax_enable_x64", True) first, if that is not set.'
        raise refuse(OWNER, "theta", str(array.dtype), "float64", fix)
    return jax.lax.convert_element_type(array, array.dtype)


@eqx.filter_jit
def _value(solver: SdpValue, theta: Any) -> Scalar:
    arrays, rest = eqx.partition(theta, eqx.is_array)

    def lagrangian(arrays: Any, x: Array, duals: Sequence[Array]) -> Array:
        return _lagrangian(solver.problem, eqx.combine(arrays, rest), x, duals)

    def pair(arrays: Any) -> Any:
        x, duals, *_, infeasible = _pair(solver, eqx.combine(arrays, rest))
        return x, duals, infeasible

    @jax.custom_jvp
    def value(arrays: Any) -> Array:
        x, duals, infeasible = pair(arrays)
        return jnp.where(infeasible, -jnp.inf, lagrangian(arrays, x, duals))

    @value.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        x, duals, infeasible = pair(*primals)
        found, slope = jax.jvp(lambda arrays: lagrangian(arrays, x, duals), primals, tangents)
        return jnp.where(infeasible, -jnp.inf, found), slope * jnp.where(jnp.isnan(found), jnp.nan, 1)

    return value(arrays)


@eqx.filter_jit
def _solution(solver: SdpValue, theta: Any) -> Optimum:
    problem = solver.problem
    x, duals, open_x, open_duals, numbers, infeasible = _pair(solver, theta)
    value = jnp.where(infeasible, -jnp.inf, _lagrangian(problem, theta, x, duals))
    floats, rest = eqx.partition(theta, eqx.is_inexact_array)

    def slope(x: Array, duals: Sequence[Array]) -> Any:
        return jax.grad(lambda own: _lagrangian(problem, eqx.combine(own, rest), x, duals))(floats)

    slopes, changes = jax.jvp(slope, (x, duals), (open_x, open_duals))
    change = _length(changes)
    spread = change / jnp.maximum(change + _length(slopes), jnp.finfo(x.dtype).tiny)
    gap, error, margin, reached = numbers
    unknowns = problem.values(x[: problem.size])
    return Optimum(value, gap, error, margin, reached, spread, infeasible, unknowns, tuple(duals))


def _length(tree: Any) -> Array:
    return jnp.sqrt(sum((jnp.sum(jnp.abs(leaf) ** 2) for leaf in jax.tree.leaves(tree)), start=jnp.zeros(())))


@eqx.filter_jit
def _faults(problem: SdpProblem, theta: Any) -> tuple[Array, Array]:
    return _coefficients(problem, theta)[-1]


def _lagrangian(problem: SdpProblem, theta: Any, x: Array, duals: Sequence[Array]) -> Array:
    """f + sum_i <Z_i, F_i - margin I>; without f, t + sum_i <Z_i, F_i - t I>, t the last of x."""
    size = problem.size
    matrices, goal = problem.inequalities(theta, x[:size])
    goal, shift = (x[size], x[size]) if problem.maximise is None else (goal, jnp.asarray(problem.margin, x.dtype))
    slack = [jnp.sum(z * f) - shift * jnp.trace(z) for z, f in zip(duals, matrices, strict=True)]
    return goal + sum(slack, start=jnp.zeros((), x.dtype))


def _coefficients(problem: SdpProblem, theta: Any) -> tuple[list[Array], list[Array], Array, Array, tuple[Array, Array]]:
    """(F_i(0), their slopes (entries, k_i, k_i), f(0), its slopes, what is left of asymmetry and of curvature, relative)."""
    size = problem.size
    at = jnp.zeros((size,), jnp.result_type(float))

    def along(direction: Array) -> Any:
        return jax.jvp(lambda x: problem.inequalities(theta, x), (at,), (direction,))

    if size:
        start, slopes = jax.vmap(along, out_axes=(None, 0))(jnp.eye(size, dtype=at.dtype))
    else:
        start = problem.inequalities(theta, at)
        slopes = jax.tree.map(lambda one: jnp.zeros((0, *one.shape), one.dtype), start)
    _require_matrices(problem, start[0], start[1])
    trial = jnp.asarray(np.random.default_rng(0).normal(size=size), at.dtype)
    skew, bent = jnp.zeros(()), jnp.zeros(())
    beyond = problem.inequalities(theta, trial)
    for first, slope, there in zip(*map(jax.tree.leaves, (start, slopes, beyond)), strict=True):
        scale = jnp.max(jnp.abs(first)) + jnp.max(jnp.abs(slope), initial=0.0) + jnp.finfo(at.dtype).tiny
        if there.ndim:
            skew = jnp.maximum(skew, jnp.max(jnp.abs(there - there.T)) / scale)
        bent = jnp.maximum(bent, jnp.max(jnp.abs(there - first - jnp.tensordot(trial, slope, 1))) / scale)
    return start[0], slopes[0], start[1], slopes[1], (skew, bent)


def _pair(solver: SdpValue, theta: Any) -> Any:
    """What `_optimality.pair` returns, at theta."""
    constant, linear, offset, objective, (skew, bent) = _coefficients(solver.problem, theta)
    fault = jnp.maximum(skew, bent)

    def on_host(*given: Any) -> Any:
        return _optimality.pair(solver.problem, solver.tolerance, *(jax.tree.map(np.asarray, one) for one in given))

    size = solver.problem.size + (solver.problem.maximise is None)
    shapes = jax.ShapeDtypeStruct((size,), offset.dtype), [jax.ShapeDtypeStruct(f.shape, f.dtype) for f in constant]
    numbers = jax.ShapeDtypeStruct((4,), offset.dtype), jax.ShapeDtypeStruct((), np.bool_)

    @jax.custom_jvp
    def solved(*given: Any) -> Any:
        return jax.pure_callback(on_host, (*shapes, *shapes, *numbers), *given, vmap_method="sequential")

    @solved.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        fix = "Take finite differences of the gradient for a Hessian; the unknowns and duals have no derivative here."
        raise refuse(OWNER, "theta", "a derivative of the optimal pair", "a first derivative of the value", fix)

    return solved(fault, constant, linear, offset, objective)


def _require_matrices(problem: SdpProblem, matrices: Any, goal: Any) -> None:
    if not matrices:
        raise refuse(problem, "lmis", "none", "one matrix or more", "Return a list.")
    for i, one in enumerate(matrices):
        if one.ndim != 2 or one.shape != one.shape[::-1] or one.dtype != jnp.float64:
            fix = "Return real symmetric matrices, [[...]] for a number, in the precision of theta."
            raise refuse(problem, "lmis", f"F_{i} {one.dtype}{list(one.shape)}", "float64 (k, k)", fix)
    if goal.shape != () or goal.dtype != jnp.float64:
        fix = "Return one number, e.g. -jnp.trace(q)."
        raise refuse(problem, "maximise", f"{goal.dtype}{list(goal.shape)}", "float64 ()", fix)
