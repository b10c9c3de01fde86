"""What a config designs for: a plant of the package, bounds on its slopes, or a model in matrices."""

import dataclasses
import functools
from typing import Any, Literal

import numpy as np

from jaxobs import plants
from jaxobs._module import refuse
from jaxobs.certificates.bounds import with_bounds
from jaxobs.cli.parts import Reader
from jaxobs.cli.reading import Integers, Matrix, Vector, read
from jaxobs.designs import Channels, NormBounded, lpv_model, midpoint_channels, slope_entries
from jaxobs.designs.lpv_from import Lpv, lpv_from
from jaxobs.designs.polytope import Polytope
from jaxobs.plants._depends import require_timeless


def plant_from(table: Any) -> Any:
    """[plant] name = "Pendulum" and its parameters; period = 0.1 makes the Euler model with that step of it."""
    return Reader().part(plants.AbstractPlant, "a plant", table, "plant").build({}, {})


@dataclasses.dataclass(frozen=True)
class Slope:
    """B dphi/dx = M F N with |F| <= 1: from a Lipschitz constant and the states that enter phi, or as matrices."""

    lipschitz: float | None = None
    states: Integers | None = None
    left: Matrix | None = None
    right: Matrix | None = None
    origin: str = "given"

    def norm_bounded(self, n: int) -> NormBounded:
        if self.lipschitz is not None:
            return NormBounded.lipschitz(n, self.lipschitz, self.states)
        if self.left is None or self.right is None:
            fix = "Or give left and right, the matrices M and N of B dphi/dx = M F N."
            raise refuse("config", "design.slope.lipschitz", "nothing", "a number", fix)
        return NormBounded(np.array(self.left), np.array(self.right), self.origin)


@dataclasses.dataclass(frozen=True)
class Bounds:
    """On the Jacobian of f, entry by entry: lower and upper (q, n). kind "midpoint": on the state and its estimate, one row,
    for quadratic f. kind "box": on the state, one row, and on the inputs; the slopes are bounded with proof, which travels with
    the certificate; relax widens them by this fraction, should that proof not close."""

    lower: Matrix
    upper: Matrix
    kind: Literal["slopes", "midpoint", "box"] = "slopes"
    origin: str = "given, not proved"
    inputs_lower: Vector = ()
    inputs_upper: Vector = ()
    relax: float = 0.0

    def channels(self, plant: Any) -> Channels:
        """For the designs that take channels."""
        if self.kind == "box":
            fix = 'Use method = "synthesize" or "prove"; or kind = "slopes" with bounds on the slopes themselves.'
            raise refuse("config", "bounds.kind", "'box'", "slopes or midpoint, for this method", fix)
        if self.kind == "midpoint":
            return midpoint_channels(plant, self._row("lower"), self._row("upper"))
        return slope_entries(self.lower, self.upper, origin=self.origin)

    def proved(self, plant: Any) -> Lpv:
        """kind "box": the error dynamics with bounds that are proved."""
        inputs = (np.array(self.inputs_lower), np.array(self.inputs_upper)) if self.inputs_lower or self.inputs_upper else None
        return lpv_from(plant, None, (np.array(self._row("lower")), np.array(self._row("upper"))), inputs=inputs)

    def travel(self, certificate: Any, plant: Any) -> Any:
        """The certificate with the proof of its bounds."""
        count = plant.m - len(self.inputs_lower)
        low = [*self._row("lower"), *self.inputs_lower, *[-np.inf] * count]
        high = [*self._row("upper"), *self.inputs_upper, *[np.inf] * count]
        zero = np.zeros(())
        require_timeless("config", plant)
        if plant.m:
            return with_bounds(certificate, lambda x, u: plant.flow(zero, x, u), low, high, relax=self.relax)
        return with_bounds(certificate, lambda x: plant.flow(zero, x, np.zeros(0)), low, high, relax=self.relax)

    def _row(self, name: str) -> Vector:
        rows = getattr(self, name)
        if len(rows) != 1:
            fix = f"Write {name} = [[-1.0, -2.0]]: one row."
            raise refuse("config", f"bounds.{name}", f"{len(rows)} rows", "one row, the bounds of the states", fix)
        return rows[0]


@dataclasses.dataclass(frozen=True)
class Model:
    """e' = (a + sum_k rho_k b_k c_k' - L output) e with lower <= rho <= upper."""

    a: Matrix
    b: Matrix
    c: Matrix
    lower: Vector
    upper: Vector
    output: Matrix
    tied: Integers = ()
    step: bool = False

    def polytope(self) -> Polytope:
        a, b, c, lower, upper, output = map(np.array, (self.a, self.b, self.c, self.lower, self.upper, self.output))
        return Polytope(a, b, c, lower, upper, output, self.tied)


@dataclasses.dataclass(frozen=True)
class Subject:
    """The plant with the bounds on its slopes, or the model in their place."""

    plant: Any = None
    bounds: Bounds | None = None
    model: Model | None = None

    @property
    def travels(self) -> bool:
        return self.model is None and self.bounds is not None and self.bounds.kind == "box"

    @functools.cached_property
    def lpv(self) -> Lpv:
        """Where the bounds are those of a box: with their proof."""
        return self.require_bounds().proved(self.require_plant())

    @property
    def origin(self) -> str:
        if self.travels:
            return self.lpv.origin
        return self.bounds.origin if self.bounds else "given"

    def finished(self, certificate: Any) -> Any:
        """With the proof of the bounds, where there is one."""
        return self.require_bounds().travel(certificate, self.require_plant()) if self.travels else certificate

    @property
    def step(self) -> bool:
        return self.model.step if self.model else isinstance(self.plant, plants.AbstractStepPlant)

    def require_plant(self) -> Any:
        if self.plant is None:
            raise refuse("config", "plant", "nothing", "a table", 'This method needs one: [plant] and name = "Pendulum".')
        return self.plant

    def require_bounds(self) -> Bounds:
        if self.bounds is None:
            fix = "[bounds] with lower and upper, rows of bounds on the Jacobian of f."
            raise refuse("config", "bounds", "nothing", "a table", fix)
        return self.bounds

    def polytope(self) -> Polytope:
        """The error dynamics without the gain."""
        if self.model is not None:
            return self.model.polytope()
        if self.travels:
            return self.lpv.model
        plant = self.require_plant()
        flow = plant.plant if isinstance(plant, plants.Discretised) else plant
        return lpv_model(plant, self.require_bounds().channels(flow))


def subject_from(tables: dict[str, Any]) -> Subject:
    """[plant] and [bounds], or [model]. ValueError names the key."""
    plant = plant_from(tables["plant"]) if "plant" in tables else None
    bounds = read(Bounds, tables["bounds"], "bounds") if "bounds" in tables else None
    return Subject(plant, bounds, read(Model, tables["model"], "model") if "model" in tables else None)
