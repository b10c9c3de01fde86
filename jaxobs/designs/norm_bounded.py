"""What is known about the slopes of phi in one bound on a norm: M F N."""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of, refuse, require_integer
from jaxobs.plants import AbstractChain

PROBES = 8  # random states and inputs at which a wrong list of states is noticed


@dataclasses.dataclass(frozen=True)
class NormBounded:
    """B dphi/dx (x, u) = M F(x, u) N with |F| <= 1 in the spectral norm, for all x and u that occur (paper 000, (55)).

    left M (n, r), right N (s, n), float64 on the host. origin: where the bound comes from, a sentence for the certificate.
    Only M F N matters: c M and N / c are the same structure, with tau c^2 for tau. ValueError for shapes that do not fit.
    """

    left: np.ndarray
    right: np.ndarray
    origin: str = "given"

    def __post_init__(self):
        for name in ("left", "right"):
            value = np.array(getattr(self, name), float)
            if value.ndim != 2 or 0 in value.shape or not np.all(np.isfinite(value)):
                raise refuse("NormBounded", name, f"shape {value.shape}", "a matrix of finite numbers", "M (n, r), N (s, n).")
            object.__setattr__(self, name, value)
        if self.left.shape[0] != self.right.shape[1]:
            given, expected = f"N of shape {self.right.shape}", f"{self.left.shape[0]} columns, one a state"
            raise refuse("NormBounded", "right", given, expected, "M F N is n by n.")

    @staticmethod
    def lipschitz(n: int, rho: float, states: Sequence[int] | None = None) -> "NormBounded":
        """|phi(a, u) - phi(b, u)| <= rho |a - b|, where only the x_j with j in `states` (from 1) enter phi; all if not given.

        M = sqrt(rho) e_n and N = sqrt(rho) times the rows e_j', the scaling of the example of paper 000.
        """
        require_integer("NormBounded.lipschitz", "n", n, 1, "It is the number of states.")
        require_lipschitz("NormBounded.lipschitz", rho)
        chosen = require_state_numbers("NormBounded.lipschitz", n, states)
        root, every = np.sqrt(float(rho)), np.eye(n)
        entering = "all states" if states is None else ", ".join(f"x_{j}" for j in chosen)
        origin = f"Lipschitz constant {float(rho)!r}; entering phi: {entering}"
        return NormBounded(root * every[:, -1:], root * every[[j - 1 for j in chosen]], origin)

    @property
    def n(self) -> int:
        return self.left.shape[0]

    def behind(self, q: int) -> tuple[np.ndarray, np.ndarray]:
        """(M, N) of the chain behind q integrators."""
        m = np.concatenate([np.zeros((q, self.left.shape[1])), self.left])
        return m, np.concatenate([np.zeros((self.right.shape[0], q)), self.right], axis=1)


def require_lipschitz(owner: str, rho: object) -> None:
    """|phi(a, u) - phi(b, u)| <= rho |a - b| with 0 < rho < infinity: ValueError, naming owner.lipschitz, for any other rho."""
    if not (isinstance(rho, (int, float, np.number)) and np.isfinite(rho) and rho > 0):
        fix = "It bounds |phi(a, u) - phi(b, u)| / |a - b| over all a, b and u."
        raise refuse(owner, "lipschitz", repr(rho), "a positive number", fix)


def require_state_numbers(owner: str, n: int, states: Sequence[int] | None) -> list[int]:
    """The named states, counted from 1; all of them for None."""
    chosen = list(range(1, n + 1)) if states is None else sorted(set(states))
    if not chosen or not all(isinstance(j, (int, np.integer)) and 1 <= j <= n for j in chosen):
        raise refuse(
            owner, "states", repr(states), f"some of the numbers 1 to {n}", "x_1 = y is the first; None is all of them."
        )
    return [int(j) for j in chosen]


def require_plant(owner: str, plant: object, slope: NormBounded | None = None) -> None:
    """A chain of the right length whose phi has no slope along the states that the structure leaves out, where it is probed.

    Probing refutes, it proves nothing: that phi knows no other state stays an assumption of the certificate.
    """
    if not isinstance(plant, AbstractChain):
        fix = "Write it as a subclass of AbstractChain."
        raise refuse(owner, "plant", type(plant).__name__, "a plant in chain form", fix)
    if slope is None:
        return
    if slope.n != plant.n:
        raise refuse(owner, "slope", f"{slope.n} states", f"{plant.n}, those of the plant", "M (n, r), N (s, n).")
    j = first_state_outside(plant, [j for j in range(plant.n) if np.any(slope.right[:, j])])
    if j is not None:
        fix = f"Name x_{j + 1} among the states that enter phi."
        raise refuse(owner, "slope", f"N without x_{j + 1}", f"a structure for a phi that changes with x_{j + 1}", fix)


def first_state_outside(plant: AbstractChain, inside: Sequence[int]) -> int | None:
    """The first state (from 0) not listed along which phi has a slope at one of some random points."""
    rng, dtype = np.random.default_rng(0), dtype_of(plant)
    x, u = (jnp.asarray(rng.normal(size=(PROBES, k)), dtype) for k in (plant.n, plant.m))
    slopes = np.asarray(jax.vmap(jax.grad(plant.phi))(x, u))
    return next((j for j in range(plant.n) if j not in inside and np.any(slopes[:, j] != 0)), None)
