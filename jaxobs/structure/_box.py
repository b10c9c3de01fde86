"""Boxes as users give them."""

from typing import Any, NamedTuple

import numpy as np

from jaxobs._module import refuse


class Sides(NamedTuple):
    """lower <= z <= upper."""

    lower: np.ndarray
    upper: np.ndarray

    def __str__(self) -> str:
        return f"{[float(f'{v:.6g}') for v in self.lower]} to {[float(f'{v:.6g}') for v in self.upper]}"


def box_of(owner: str, field: str, given: Any, size: int, finite: bool = False) -> Sides:
    """(lower, upper), each of `size` numbers; all of R^size for None."""
    if given is None:
        if finite and size:
            raise refuse(
                owner, field, "None", f"(lower, upper), {size} numbers each", f"For example ({[-1.0] * size}, {[1.0] * size})."
            )
        return Sides(np.full(size, -np.inf), np.full(size, np.inf))
    fix = f"For example ({[-1.0] * size}, {[1.0] * size})."
    try:
        lower, upper = (np.atleast_1d(np.asarray(side, float)) for side in given)
    except (TypeError, ValueError) as error:
        raise refuse(owner, field, repr(given), f"(lower, upper), {size} numbers each", fix) from error
    if lower.shape != (size,) or upper.shape != (size,):
        raise refuse(owner, field, f"shapes {lower.shape} and {upper.shape}", f"(lower, upper), {size} numbers each", fix)
    if not np.all(lower <= upper) or (finite and not np.all(np.isfinite([lower, upper]))):
        kind = "finite numbers, lower <= upper" if finite else "lower <= upper"
        raise refuse(owner, field, f"{lower.tolist()} to {upper.tolist()}", kind, fix)
    return Sides(lower, upper)
