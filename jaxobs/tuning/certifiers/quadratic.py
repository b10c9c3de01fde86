"""One quadratic Lyapunov function for all parameters of a box: searched along with the gains, proved exactly at the end.

    P > 0,    -(F'P + P F) - 2 rate P > 0   at all corners F of the error dynamics,      P = R R',

for step models [factor P, F'P; *, factor P] > 0. Channels may be covered by multipliers in place of their corners, and a block
of bounded norm joins in the same way (see `certificates.Corners`): with F at the middle of the box, P U on the side,

    [ -(F'P + P F) - 2 rate P - V'tau V    -P U ]
    [  *                                    tau ]  > 0,       U = [b, left],  V = [half (c), right].

All of it in coordinates in which the first P is the identity, and divided by P: the log-barrier of P^-1/2 (..) P^-1/2.
"""

import dataclasses
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from jaxobs._module import Scalar, refuse, require_instance
from jaxobs.certificates import AbstractCertificate, Corners, StepCorners
from jaxobs.designs import Infeasible, NormBounded, Polytope
from jaxobs.designs._climb import climb
from jaxobs.designs._dynamics import Dynamics, centred
from jaxobs.designs._frame import frame
from jaxobs.designs._proofs import unit_size
from jaxobs.designs._rates import fastest
from jaxobs.designs.covers import cover_of
from jaxobs.designs.error_gain import error_gain
from jaxobs.designs.polytope import as_tuples
from jaxobs.tuning.certifiers.base import AbstractCertifier, Start, blocks, minus_log_det
from jaxobs.tuning.charts import Lyapunov

MANY = 64  # corners: with more of them multipliers take their place


@dataclasses.dataclass(frozen=True, eq=False)
class Quadratic(AbstractCertifier):
    """Decay of e' = (a + sum_k rho_k b_k c_k' + M Delta N - L output) e at `rate` for all rho in the box and |Delta| <= 1.

    model: the error dynamics without the gain, from `designs.lpv_model` or `lpv_from`; `model.behind(q)` behind q integrators.
    slope: M and N, of a block of bounded norm (the S-lemma), None if there is none. step: for e+; the rate is then the factor a
    step. cover: "corners", or "multiplier"; by itself corners up to 64 of them. origin: where the bounds come from.
    ValueError for step models with multipliers or a block, a gain that does not fit. Source: Boyd et al., Linear Matrix
    Inequalities in System and Control Theory, 1994, sections 5.1 and 8.1.
    """

    model: Polytope
    slope: NormBounded | None = None
    step: bool = False
    cover: Literal["corners", "multiplier"] | None = None
    origin: str = "given"

    def __post_init__(self):
        require_instance(self, "model", self.model, Polytope, "Make it with jaxobs.designs.lpv_model(plant, channels).")
        if self.cover not in (None, "corners", "multiplier"):
            raise refuse(self, "cover", repr(self.cover), "'corners', 'multiplier' or None", "Leave it out.")
        chosen = self.cover or ("corners" if self.step or 2 ** len(set(self.model.tied)) <= MANY else "multiplier")
        object.__setattr__(self, "cover", chosen)
        if self.slope is not None and self.slope.n != self.model.n:
            given, fix = f"{self.slope.n} states", "Put zeros for the integrators: NormBounded(*slope.behind(q))."
            raise refuse(self, "slope", given, f"{self.model.n} states", fix)
        if self.step and (chosen == "multiplier" or self.slope is not None):
            fix = "Cover the box by its corners; for a block see jaxobs.designs.euler_free."
            raise refuse(self, "step", "True with multipliers or a block", "a box with corners", fix)

    @property
    def unit(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return "a step" if self.step else "1/s"

    def start(self, observer, rate):
        """From the P that proves the largest rate of this gain, in floats; of a gain without one, a Lyapunov matrix of the
        middle of the box."""
        d = self._dynamics(observer)
        p, taus, reached = self._first(d)
        t = centred(p)
        (u, of_u), (v, of_v) = self._blocks(t)
        if self.slope is not None:  # its multiplier is not known yet
            taus = np.append(taus, np.linalg.norm(u[:, of_u == len(taus)]) / max(np.linalg.norm(v[of_v == len(taus)]), 1e-300))
        return Start(*self._placed(t, taus, 1.0 if self.step else d.in_coordinates(t).speed), reached)

    def recentred(self, fixed, free):
        root = np.asarray(Lyapunov(self.model.n).root(free["root"]))
        t = scipy.linalg.solve_triangular(root, np.asarray(fixed["t"]).T, lower=True).T
        return self._placed(t, np.asarray(self._taus(fixed, free)), float(fixed["speed"]))

    def _placed(self, t: np.ndarray, taus: np.ndarray, speed: float) -> tuple[Any, Any]:
        """(constants, witnesses) in the coordinates t^-1 e, where P = I, and the time speed * t."""
        model = self.model.in_coordinates(t)
        (u, of_u), (v, of_v) = self._blocks(t)
        middle = (model.lower + model.upper) / 2
        fixed = {
            "t": t, "inverse": np.linalg.inv(t), "speed": np.asarray(speed), "a": model.a, "b": model.b, "c": model.c,
            "output": model.output, "rho": model.parameters() if self.cover == "corners" else middle[None], "u": u, "v": v,
            "of_u": of_u, "of_v": of_v, "tau": taus / speed,
        }  # fmt: skip
        free = {"root": np.zeros(model.n * (model.n + 1) // 2), "log_tau": np.zeros(self._multipliers)}
        return jax.tree.map(jnp.asarray, fixed), jax.tree.map(jnp.asarray, free)

    def barrier(self, observer, fixed, free, rate):
        speed, n = fixed["speed"], self.model.n
        gain = fixed["inverse"] @ error_gain(observer).astype(fixed["a"].dtype)
        f = (fixed["a"] - gain @ fixed["output"] + (fixed["b"] * fixed["rho"][:, None, :]) @ fixed["c"]) / speed
        if self.step or not self._multipliers:
            return decay_barrier(f, free["root"], rate if self.step else rate / speed, step=self.step)
        p = Lyapunov(n).decode(free["root"])
        tau = fixed["tau"] * jnp.exp(free["log_tau"])
        side = -(p @ fixed["u"]) / speed / jnp.sqrt(tau[fixed["of_u"]])  # of tau = I
        v = jnp.sqrt(tau[fixed["of_v"]])[:, None] * fixed["v"]
        side = jnp.broadcast_to(side, (len(f), *side.shape))
        unit = jnp.broadcast_to(jnp.eye(side.shape[2], dtype=f.dtype), (len(f), side.shape[2], side.shape[2]))
        whole = blocks([[decrease(f, p, rate / speed) - v.T @ v, side], [jnp.swapaxes(side, 1, 2), unit]])
        rows = len(f) * (n + side.shape[2])
        return (minus_log_det(whole) + 2 * jnp.sum(free["root"][:n]) * len(f)) / rows

    def prove(self, observer, fixed, free, rate):
        d = self._dynamics(observer)
        for p, taus in self._witnesses(d, fixed, free):
            certificate = self._certificate(d.gain, p, taus, rate)
            if certificate.verify():
                return certificate
        reason = f"no P that was found for this gain proves the rate {rate:.6g} {self.unit} in exact arithmetic"
        raise Infeasible(reason, -0.0, "Ask for a little less, so that the inequalities hold with a margin.")

    @property
    def _multipliers(self) -> int:
        """One for each channel, one for the whole block."""
        return (self.model.r if self.cover == "multiplier" else 0) + (self.slope is not None)

    def _dynamics(self, observer: Any) -> Dynamics:
        gain = np.asarray(error_gain(observer), float)
        self.model.closed(gain)  # ValueError for a gain that does not fit
        n, r, p = self.model.n, self.model.r, self.model.p
        return Dynamics(self.model, gain, np.zeros((r, p)), np.eye(n), np.zeros((n, 0)), np.zeros((p, 0)))

    def _taus(self, fixed: Any, free: Any) -> Any:
        """In the user's units of time."""
        return fixed["tau"] * jnp.exp(free["log_tau"]) * fixed["speed"]

    def _first(self, d: Dynamics) -> tuple[np.ndarray, np.ndarray, float]:
        """(P, the multipliers of the channels, the rate that both prove); of step models the factor."""
        if self.step:
            p, factor = _step_first(d)
            return p, np.zeros(0), factor
        proof = fastest(d, cover_of("tune", d.model, "multiplier" if self.cover == "multiplier" else "lazy"))
        taus = np.diagonal(proof.tau) if self.cover == "multiplier" else np.zeros(0)
        return proof.p, taus, -np.inf if self.slope is not None else proof.rate

    def _blocks(self, t: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """(U (n, w), the multiplier of each column) and (V (k, n), that of each row), in the coordinates t^-1 e."""
        n, r, channels = self.model.n, self.model.r, self.cover == "multiplier"
        half = (self.model.upper - self.model.lower) / 2
        u, v = (self.model.b, half[:, None] * self.model.c) if channels else (np.zeros((n, 0)), np.zeros((0, n)))
        of_u = of_v = np.arange(r if channels else 0)
        if self.slope is not None:
            left, right = self.slope.left, self.slope.right
            of_u, of_v = (
                np.append(of, np.full(k, self._multipliers - 1)) for of, k in ((of_u, left.shape[1]), (of_v, len(right)))
            )
            u, v = np.concatenate([u, left], 1), np.concatenate([v, right], 0)
        return (np.linalg.solve(t, u), of_u), (v @ t, of_v)

    def _witnesses(self, d: Dynamics, fixed: Any, free: Any):
        """(P, multipliers): those of the search; then those that a solver finds for the same gain."""
        side = np.asarray(Lyapunov(self.model.n).root(free["root"])).T @ np.asarray(fixed["inverse"])
        yield side.T @ side, np.asarray(self._taus(fixed, free))
        if self.slope is None and self.cover == "corners":
            yield self._first(d)[0], np.zeros(0)

    def _certificate(self, gain: np.ndarray, p: np.ndarray, taus: np.ndarray, rate: float) -> AbstractCertificate:
        p, unit = unit_size(p)
        fields = self.model.fields() | {"gain": as_tuples(gain), "p": as_tuples(p), "origin": self.origin}
        if self.step:
            return StepCorners(**fields, factor=float(rate))
        if self.cover == "multiplier":
            fields["taus"] = as_tuples(taus[: self.model.r] / unit)
        if self.slope is not None:
            block = {"left": as_tuples(self.slope.left), "right": as_tuples(self.slope.right), "tau": float(taus[-1] / unit)}
            fields |= block
        return Corners(**fields, rate=float(rate))


def decrease(f: Float[Array, "corners n n"], p: Float[Array, "n n"], rate: Scalar) -> Float[Array, "corners n n"]:
    """-(F'P + P F) - 2 rate P."""
    pf = p @ f
    return -(pf + jnp.swapaxes(pf, 1, 2)) - 2 * rate * p


def decay_barrier(f: Float[Array, "corners n n"], root: Array, rate: Scalar, *, step: bool) -> Scalar:
    """-log det P^-1/2 (..) P^-1/2 of the decrease at all corners, or of [factor P, F'P; *, factor P], by row; P = R R'."""
    n, rows = f.shape[-1], f.shape[0] * f.shape[-1]
    p, of_p = Lyapunov(n).decode(root), 2 * jnp.sum(root[:n]) * len(f)  # sum log det P
    if not step:
        return (minus_log_det(decrease(f, p, rate)) + of_p) / rows
    pf, whole = p @ f, jnp.broadcast_to(rate * p, f.shape)
    return (minus_log_det(blocks([[whole, jnp.swapaxes(pf, 1, 2)], [pf, whole]])) + 2 * of_p) / (2 * rows)


def _step_first(d: Dynamics) -> tuple[np.ndarray, float]:
    """The P of the least factor a step that is found for this gain; of an unstable one, of the gain in slower time."""
    f = d.at_middle()
    radius = max(float(np.max(np.abs(np.linalg.eigvals(f)))), 1e-3)
    way = climb(frame(d.model, step=True, gain=d.gain), np.inf, d.gain)
    if way.found is not None:
        return way.place.lyapunov(way.found.values["p"]), way.place.rate(way.kappa)
    p = scipy.linalg.solve_discrete_lyapunov((f / (1.1 * radius)).T, np.eye(d.model.n))
    return (p + p.T) / 2, np.inf
