"""What a gain shall be good at, beside its decay rate: a guaranteed noise level, an energy gain, a small gain."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.designs._dynamics import Dynamics
from jaxobs.designs.polytope import Polytope


@dataclasses.dataclass(frozen=True)
class H2:
    """The mean of |E e|^2 under white noises of unit intensity w and v, for e' = F(rho) e + process w - L noise v.

    weight E (s, n), process (n, m), noise (p, k); identities where not given. Guaranteed for every rho(t) in the box by

        F'Q + Q F + E'E < 0,               level = tr(process'Q process) + tr(noise'L'Q L noise)         ("energy"),

    by Ito's rule, also where rho depends on the error and so on the noise, as that of a nonlinear observer does. independent:
    rho(t) does not, so that, whichever is lower, this will do as well:

        F X + X F' + process process' + L noise noise'L' < 0,        level = tr(E X E')                  ("covariance").

    Source: Boyd et al., 1994, sections 6.2.2 and 6.2.1.
    """

    weight: Any = None
    process: Any = None
    noise: Any = None
    independent: bool = False

    @property
    def forms(self) -> tuple[str, ...]:
        return ("covariance", "energy") if self.independent else ("energy",)


@dataclasses.dataclass(frozen=True)
class L2:
    """The gain from the energy of (w, v) to that of E e, e' = F(rho) e + process w - L noise v, shapes as for H2:

    [ -(F'Q + Q F) - E'E     -Q process     Q L noise ]
    [                        level^2 I                ]  > 0.      Source: Boyd et al., 1994, section 6.3.2.
    """

    weight: Any = None
    process: Any = None
    noise: Any = None
    forms = ("gain",)


@dataclasses.dataclass(frozen=True)
class Gain:
    """|L|, the Frobenius norm."""


Objective = H2 | L2 | Gain


def require_independent(owner: str, objective: Objective) -> None:
    """With an injection into f levels are found by the covariance form alone: ValueError for an H2 that does not allow it."""
    if isinstance(objective, H2) and not objective.independent:
        fix = "Say H2(..., independent=True) if rho(t) does not depend on the noise; or take L2, or Gain."
        raise refuse(owner, "objective", "H2 for an observer with inner injection", "independent=True", fix)


def dynamics(owner: str, lpv: Polytope, gain: np.ndarray, inner: np.ndarray | None, objective: Objective) -> Dynamics:
    """The error dynamics with the objective's weights; ValueError for shapes that do not fit."""
    n, p, r = lpv.n, lpv.p, lpv.r
    lpv.closed(gain)
    sizes = {"weight": (None, n), "process": (n, None), "noise": (p, None)}
    parts = {}
    for name, (rows, columns) in sizes.items():
        given = getattr(objective, name, None)
        one = np.eye(columns or rows or 1) if given is None else np.array(given, float)
        if one.ndim != 2 or one.shape[0] != (rows or one.shape[0]) or one.shape[1] != (columns or one.shape[1]):
            expected = f"({rows or 'any'}, {columns or 'any'})"
            fix = "weight has one column a state, process one row a state, noise one row an output."
            raise refuse(objective, name, f"shape {one.shape}", expected, fix)
        if not np.all(np.isfinite(one)):
            raise refuse(objective, name, one.tolist(), "finite numbers", "Leave out what does not count.")
        parts[name] = one
    inner = np.zeros((r, p)) if inner is None else np.array(inner, float)
    if inner.shape != (r, p):
        raise refuse(owner, "inner", f"shape {inner.shape}", f"{(r, p)}", "One row a channel, one column an output.")
    if np.any(inner):
        require_independent(owner, objective)
    return Dynamics(lpv, np.array(gain, float), inner, **parts)
