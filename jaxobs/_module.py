"""The base of every object that carries numbers, and the checks that all objects share.

An object is an `equinox.Module`: a pytree whose numbers are leaves. `param()` turns what a user types (a float, a list, a
NumPy array, a tracer) into an array of a strong float dtype, so that replacing one number by another never retraces.
"""

import dataclasses
import reprlib
from types import NoneType, UnionType
from typing import Any, TypeAlias, TypeVar, dataclass_transform, get_args, overload

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

Scalar = Float[Array, ""]
OptionalScalar: TypeAlias = Scalar | None
Numbers = ArrayLike | list[Any] | tuple[Any, ...]  # what a user may give for an array
T = TypeVar("T")


@overload
def as_param(value: None) -> None: ...
@overload
def as_param(value: Numbers) -> Array: ...
def as_param(value: Numbers | None) -> Array | None:
    """A strong float array: floating arrays keep their dtype, every other real number takes JAX's default float."""
    if value is None:
        return None
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError) as error:  # a string, a ragged list
        raise _not_real(value) from error
    if not is_real(array.dtype):
        raise _not_real(value)
    strong = jnp.issubdtype(array.dtype, jnp.floating) and not array.weak_type
    return jax.lax.convert_element_type(array, array.dtype if strong else jnp.result_type(float))


def is_real(dtype: Any) -> bool:
    """Whether numbers of this dtype are floats, integers or truth values."""
    return any(jnp.issubdtype(dtype, kind) for kind in (jnp.floating, jnp.integer, jnp.bool_))


def _not_real(value: Any) -> ValueError:
    fix = "Give a number, an array, or a list whose rows have one length."
    return ValueError(f"Parameter: given {reprlib.repr(value)}; expected real numbers. {fix}")


def param(**kwargs: Any) -> Any:
    """A field that holds a number or an array of numbers: a differentiable, batchable leaf."""
    return eqx.field(converter=as_param, **kwargs)


def static(**kwargs: Any) -> Any:
    """A field that fixes shapes (an integer, a name): part of the structure, never traced."""
    return eqx.field(static=True, **kwargs)


@dataclass_transform(field_specifiers=(eqx.field, param, static))
class Module(eqx.Module):
    """An equinox Module whose float leaves share one dtype, and whose parameters are finite and, if scalars, single numbers."""

    def __check_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            optional = value is None and NoneType in get_args(field.type)
            if optional or field.metadata.get("converter") is not as_param:
                continue
            if field.type in (Scalar, OptionalScalar):
                require_shape(self, field.name, value, (), "A grid of values goes through jaxobs.grid and jaxobs.over.")
            require_finite(self, field.name, value)
        dtypes = {jnp.dtype(leaf.dtype) for leaf in float_leaves(self)}
        if len(dtypes) > 1:
            names = " and ".join(sorted(str(d) for d in dtypes))
            raise ValueError(
                f"{type(self).__name__}: given parameters of {names}; expected one precision. "
                "Build every part from Python floats, or convert with jaxobs.astype(part, dtype)."
            )


def float_leaves(tree: Any) -> list[Array]:
    return [leaf for leaf in jax.tree.leaves(tree) if eqx.is_inexact_array(leaf)]


def dtype_of(*trees: Any) -> Any:
    """The float dtype of an object: that of its leaves, or JAX's default if it has none."""
    leaves = float_leaves(trees)
    return leaves[0].dtype if leaves else jnp.result_type(float)


def astype(tree: T, dtype: Any) -> T:
    """The same object with every float leaf in another precision, e.g. `jaxobs.astype(observer, jnp.float32)`."""
    return jax.tree.map(lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf, tree)


def concrete(value: Any) -> np.ndarray | None:
    """The value as NumPy, or None while it is being traced (then only its shape can be checked)."""
    return None if isinstance(value, jax.core.Tracer) else np.asarray(value)


def refuse(owner: Any, field: str, given: Any, expected: str, fix: str) -> ValueError:
    """The one form of message for a bad argument: class, field, given, expected, what to try."""
    name = owner if isinstance(owner, str) else type(owner).__name__
    return ValueError(f"{name}.{field}: given {given}; expected {expected}. {fix}")


def require_instance(owner: Any, field: str, value: Any, kind: type | UnionType, fix: str) -> None:
    """An object of this class, or of one of these: not the class itself, nor anything that holds or resembles it."""
    if not isinstance(value, kind):
        kinds = get_args(kind) if isinstance(kind, UnionType) else (kind,)
        given = f"the class {value.__name__}" if isinstance(value, type) else f"{type(value).__name__} {reprlib.repr(value)}"
        names = ["None" if one is NoneType else one.__name__ for one in kinds]
        raise refuse(owner, field, given, f"an instance of {' or '.join(names)}", fix)


def require_shape(owner: Any, field: str, value: Any, shape: tuple[int, ...], fix: str) -> None:
    if np.shape(value) != shape:
        raise refuse(owner, field, f"shape {np.shape(value)}", f"shape {shape}", fix)


def require_finite(owner: Any, field: str, value: Any) -> None:
    known = _known(owner, field, value)
    if known is not None and not np.all(np.isfinite(known)):
        raise refuse(owner, field, known, "finite numbers", "Remove the NaN or infinity at its origin.")


def require_positive(owner: Any, field: str, value: Any, fix: str) -> None:
    known = _known(owner, field, value)
    if known is not None and not np.all(known > 0):
        raise refuse(owner, field, known, "a positive number", fix)


def require_nonnegative(owner: Any, field: str, value: Any, fix: str) -> None:
    known = _known(owner, field, value)
    if known is not None and not np.all(known >= 0):
        raise refuse(owner, field, known, "a number >= 0", fix)


def _known(owner: Any, field: str, value: Any) -> np.ndarray | None:
    """`concrete`, of a number that has to be given."""
    if value is None:
        raise refuse(owner, field, "None", "a number", "It has no default.")
    return concrete(value)


def require_integer(owner: Any, field: str, value: Any, least: int, fix: str) -> None:
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
        raise refuse(owner, field, repr(value), f"an integer >= {least}", fix)


def key_axes(value: Any) -> int | None:
    """The number of axes of an array of PRNG keys, 0 for a single one, of either style; None for anything else."""
    dtype = getattr(value, "dtype", None)
    if dtype is None:
        return None
    if jnp.issubdtype(dtype, jax.dtypes.prng_key):
        return value.ndim
    return value.ndim - 1 if dtype == jnp.uint32 and value.ndim > 0 else None


def check(module: Module) -> None:
    """Repeat the construction checks of an object and its parts, for values replaced since (`eqx.tree_at`, `grid`)."""
    for cls in type(module).__mro__:
        if "__check_init__" in cls.__dict__:
            cls.__check_init__(module)
    for field in dataclasses.fields(module):
        for part in jax.tree.leaves(getattr(module, field.name), is_leaf=lambda x: isinstance(x, Module)):
            if isinstance(part, Module):
                check(part)
