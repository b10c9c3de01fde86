"""A plant from two functions: x' = f(x, u) or x+ = f(x, u), y = h(x, u), written with jax.numpy."""

import inspect
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import as_param, dtype_of, is_real, refuse, require_finite, require_integer, static
from jaxobs.plants.base import AbstractFlowPlant, AbstractStepPlant, everywhere

Function = Callable[..., Any]


def _numbers(tree: Any) -> Any:
    """Every number of a pytree as a strong float array: a leaf that can be batched and differentiated."""
    return None if tree is None else jax.tree.map(as_param, tree)


class FlowFunction(AbstractFlowPlant):
    """x' = dynamics(x, u), y = output(x, u), or with a third argument `parameters`; `from_function` makes one."""

    dynamics: Function = static()
    output: Function = static()
    parameters: Any = eqx.field(converter=_numbers, default=None)
    n: int = static(default=1)
    m: int = static(default=0)
    p: int = static(default=1)

    def __check_init__(self):
        _check("from_function", self)

    def flow(self, t, x, u):
        return _values(self, self.dynamics, x, u)

    def h(self, x, u):
        return _values(self, self.output, x, u)

    def disturbance_matrix(self):
        return everywhere(self)


class StepFunction(AbstractStepPlant):
    """x+ = dynamics(x, u), y = output(x, u), or with a third argument `parameters`; `from_step_function` makes one."""

    dynamics: Function = static()
    output: Function = static()
    parameters: Any = eqx.field(converter=_numbers, default=None)
    n: int = static(default=1)
    m: int = static(default=0)
    p: int = static(default=1)

    def __check_init__(self):
        _check("from_step_function", self)

    def step(self, k, x, u):
        return _values(self, self.dynamics, x, u)

    def h(self, x, u):
        return _values(self, self.output, x, u)

    def disturbance_matrix(self):
        return everywhere(self)


def from_function(f: Function, h: Function, *, n: int, m: int = 0, p: int = 1, parameters: Any = None) -> FlowFunction:
    """The plant x' = f(x, u), y = h(x, u) with n states, m inputs and p outputs.

    f, h: functions of x (n,) and u (m,), also for m = 0, written with jax.numpy; f returns n numbers and h returns p, as an
    array, as a list of scalars, or as one scalar where there is one number. parameters: a dict, tuple or any pytree of
    numbers that f and h get as third argument, f(x, u, parameters): these are leaves of the plant, which `jaxobs.grid`
    batches, `jax.grad` differentiates and `jaxobs.astype` converts, where a constant inside f is none of that.

    ValueError, which names the argument: for lambdas, functions defined inside functions and callable objects (a plant is data
    that is pickled, and they have no name to be imported by); for a wrong number of arguments or of values; for what f raises
    on JAX arrays, with the usual remedy. `jaxobs.structure.forms(plant)` says which designs are for this plant.

        def f(x, u, c):
            return [x[1], -c["stiffness"] * jnp.sin(x[0]) + u[0]]

        def h(x, u, c):
            return x[0]

        plant = jaxobs.plants.from_function(f, h, n=2, m=1, parameters={"stiffness": 9.81})
    """
    return FlowFunction(f, h, parameters, n, m, p)


def from_step_function(f: Function, h: Function, *, n: int, m: int = 0, p: int = 1, parameters: Any = None) -> StepFunction:
    """The plant x+ = f(x, u), y = h(x, u) with n states, m inputs and p outputs; arguments and errors as in `from_function`."""
    return StepFunction(f, h, parameters, n, m, p)


def _arguments(plant: Any, x: Any, u: Any) -> tuple[Any, ...]:
    return (x, u) if plant.parameters is None else (x, u, plant.parameters)


def _values(plant: Any, function: Function, x: Float[Array, " n"], u: Float[Array, "..."]) -> Float[Array, " r"]:
    """What the function returns, as a vector of the precision of x."""
    return _vector(function(*_arguments(plant, x, u)), x.dtype)


def _vector(found: Any, dtype: Any) -> Array:
    if isinstance(found, (list, tuple)):
        found = jnp.stack([jnp.asarray(value).astype(dtype) for value in found]) if found else jnp.zeros((0,), dtype)
    return jnp.atleast_1d(jnp.asarray(found)).astype(dtype)


def _check(owner: str, plant: FlowFunction | StepFunction) -> None:
    for name, least in (("n", 1), ("m", 0), ("p", 1)):
        require_integer(owner, name, getattr(plant, name), least, "It counts states (n), inputs (m) or outputs (p).")
    for leaf in jax.tree.leaves(plant.parameters):
        require_finite(owner, "parameters", leaf)
    for argument, function, size, of in (("f", plant.dynamics, plant.n, "n"), ("h", plant.output, plant.p, "p")):
        _require_importable(owner, argument, function)
        _require_signature(owner, argument, function, plant.parameters)
        _require_shape(owner, argument, plant, function, size, of)


def _require_importable(owner: str, argument: str, function: Any) -> None:
    """Plants are pickled (studies send them to workers), and a function is pickled by its name."""
    name = getattr(function, "__qualname__", None)
    if not callable(function) or isinstance(function, type):
        raise refuse(owner, argument, repr(function), "a function", "Write def f(x, u): return ... at the top of a file.")
    if inspect.ismethod(function) or name is None:
        given = f"a {type(function).__name__}"
        fix = "Write a function; its numbers go into parameters=."
        raise refuse(owner, argument, given, "a function that is imported by its name: plants are pickled", fix)
    if "<lambda>" in name or "<locals>" in name:
        given = "a lambda" if "<lambda>" in name else f"{name}, defined inside a function"
        fix = "Write it with def at the top level of a file or notebook; what it takes from around it goes into parameters=."
        raise refuse(owner, argument, given, "a function that is imported by its name: plants are pickled", fix)


def _require_signature(owner: str, argument: str, function: Function, parameters: Any) -> None:
    count = 2 if parameters is None else 3
    try:
        signature = inspect.signature(function)
    except ValueError:  # some built-in functions have none
        return
    try:
        signature.bind(*range(count))
    except TypeError as error:
        wanted = f"{argument}(x, u)" if parameters is None else f"{argument}(x, u, parameters)"
        fix = "u is an empty array where m = 0; the third argument is there where parameters= is given."
        raise refuse(owner, argument, f"{function.__name__}{signature}", wanted, fix) from error


def _require_shape(owner: str, argument: str, plant: Any, function: Function, size: int, of: str) -> None:
    dtype = dtype_of(plant)
    x, u = jax.ShapeDtypeStruct((plant.n,), dtype), jax.ShapeDtypeStruct((plant.m,), dtype)
    try:
        _require_indices(plant, function)
        raw = jax.eval_shape(lambda x, u: function(*_arguments(plant, x, u)), x, u)
    except Exception as error:  # whatever a user's function may raise
        _explain(owner, argument, function, error)
    bad = next((leaf.dtype for leaf in jax.tree.leaves(raw) if not is_real(leaf.dtype)), None)
    if bad is not None:
        raise refuse(owner, argument, f"values of dtype {bad}", "real numbers", "Split complex numbers into two states.")
    try:
        found = jax.eval_shape(lambda x, u: _values(plant, function, x, u), x, u)
    except Exception as error:  # lists of arrays of several lengths
        _explain(owner, argument, function, error)
    if found.shape != (size,):
        shape = f"{function.__name__}, which returns shape {found.shape}"
        fix = f"Return one number for each of {of} = {size}: a list of scalars, or an array made by jnp.stack or a slice."
        raise refuse(owner, argument, shape, f"shape ({size},), {of} = {size}", fix)


def _require_indices(plant: Any, function: Function) -> None:
    """IndexError for x[n] and beyond: NumPy raises it, where JAX takes the last entry without a word."""
    x, u = np.zeros(plant.n), np.zeros(plant.m)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            function(*_arguments(plant, x, u))
        except IndexError:
            raise
        except Exception:  # it need not take NumPy arrays: what JAX says of it comes next
            return


def _explain(owner: str, argument: str, function: Function, error: Exception) -> NoReturn:
    said = str(error).strip().splitlines()
    given = f"{getattr(function, '__name__', argument)}, which raised {type(error).__name__}" + (f": {said[0]}" if said else "")
    match error:
        case jax.errors.TracerBoolConversionError():
            fix = "An `if` on a state becomes jnp.where(condition, yes, no)."
        case jax.errors.TracerArrayConversionError() | jax.errors.ConcretizationTypeError():
            fix = "Use jax.numpy in place of numpy and math, and float(...) of no state."
        case TypeError() if "float()" in str(error) or "must be real number" in str(error):
            fix = "Use jax.numpy in place of numpy and math, and float(...) of no state."
        case TypeError() if "dtype" in str(error) or "promotion" in str(error):
            fix = "Make constants of the precision of x: jnp.asarray(value, x.dtype)."
        case IndexError():
            fix = "States count from x[0] to x[n - 1], inputs from u[0] to u[m - 1]."
        case _:
            fix = "It is called with JAX arrays x (n,) and u (m,); call it by hand on jnp.zeros to see where it fails."
    raise refuse(owner, argument, given, "a function of JAX arrays", fix) from error
