"""What `forms` found, in sentences."""

import math
import textwrap
from typing import Any

import numpy as np

from jaxobs.structure.orders import TIMED

WIDTH = 110
DESIGNS = {  # a form, and the designs (of jaxobs.designs) and observers (of jaxobs.observers) that ask for it
    "chain": ("riccati, s_lemma, high_gain_lmi, standard_high_gain, ladder, euler_riccati", "HighGain, IntegralHighGain"),
    "triangular": ("triangular", "Luenberger, Lyapunov"),
    "blocks": ("lpv_lmi with lpv_from", "Lyapunov"),
    "state_affine": ("lpv_lmi with lpv_from, for inputs within bounds", "Lyapunov, ContinuousKalman"),
    "lipschitz": ("lpv_lmi with proved_channels, circle, synthesize", "Luenberger, InnerInjection"),
    "linear": ("lpv_lmi with lpv_from, synthesize with lpv_from", "Luenberger, ContinuousKalman"),
}
HEADINGS = {
    "linear": "linear, x' = A x + B u, y = C x",
    "chain": "a chain of integrators, y = x1, x1' = x2, ..., xn' = phi(x, u)",
    "triangular": "triangular, xi' = ai(u) x(i+1) + gi(u, x1, ..., xi), y = x1",
    "blocks": "triangular by blocks, one block of states behind the other",
    "state_affine": "affine in the state, x' = A(u) x + b(u), y = C x",
    "lipschitz": "x' = A x + B f(x) + g(y, u), y = C x",
}
STEP = {"linear": "linear, x+ = A x + B u, y = C x"}
LEGEND = "0 zero, 1 one, c another constant, u of inputs or time alone, * of the state"


def describe(found: Any) -> str:
    """The pattern, each form with its designs, each missing form with its reason."""
    plant = found.plant
    dot, step = ("+", True) if hasattr(plant, "step") else ("'", False)
    name = type(plant).__name__
    lines = [f"{name}: x{dot} = f(x, u), n = {plant.n} states, m = {plant.m} inputs, p = {plant.p} outputs", ""]
    if found.source == "nothing":
        said = f"Nothing is known of f: {found.why['pattern']} Designs that take bounds on trust still apply."
        return "\n".join([lines[0], *_wrapped(said)])
    lines += _matrices(found.flow, found.output)
    lines += ["", *_wrapped(f"These entries hold for every x and u, by {found.source}.")]
    if found.jumps:
        switches = ", ".join(found.jumps)
        lines += _wrapped(
            f"f or h switches at {switches}: whether it is continuous there is not proved, and designs assume it."
        )
    headings = STEP if step else HEADINGS
    present = [form for form in headings if form in found.parts]
    lines += ["", "It is" + ("" if present else " in none of these forms.")]
    for form in present:
        lines += _wrapped(f"- {headings[form]}{_order(form, found.parts[form])}.", 2)
        lines += _wrapped(f"designs: {DESIGNS[form][0]}; observers: {DESIGNS[form][1]}.", 4)
    if relying := [form for form in present if form in found.relying]:
        lines += _wrapped(f"For the parameters that it has, and not for all: {', '.join(relying)}.")
    missing = [form for form in headings if form not in present and not _moot(form, present, found)]
    if missing:
        lines.append("It is not")
    for form in missing:
        lines += _wrapped(f"- {headings[form]}: {found.why[form]}.", 2)
    lines += _advice(found, present, step)
    if found.slopes is not None:
        lines += ["", *_bounds(found.slopes)]
    return "\n".join(lines)


def _wrapped(text: str, indent: int = 0) -> list[str]:
    rest = " " * (indent + 2 if text.startswith("- ") else indent)
    return textwrap.wrap(text, WIDTH, initial_indent=" " * indent, subsequent_indent=rest, break_long_words=False)


def _matrices(flow: np.ndarray, output: np.ndarray) -> list[str]:
    rows = max(len(flow), len(output))
    legend = LEGEND.split(", ")
    lines = []
    for i in range(max(rows, len(legend))):
        left = "df/dx =  " if i == 0 else " " * 9
        left += f"[{' '.join(flow[i])}]" if i < len(flow) else " " * (2 * len(flow[0]) + 1)
        right = "dh/dx =  " if i == 0 else " " * 9
        right += f"[{' '.join(output[i])}]" if i < len(output) else " " * (2 * len(flow[0]) + 1)
        lines.append(f"    {left}     {right}     {legend[i] if i < len(legend) else ''}".rstrip())
    return lines


def _order(form: str, parts: tuple[Any, ...]) -> str:
    order = parts[0] if form in ("chain", "triangular", "blocks") else ()
    if tuple(order) == tuple(range(len(order))):
        return ""
    return f", with the states in the order {', '.join(f'x{i + 1}' for i in order)} (found.{form} has them so)"


def _moot(form: str, present: list[str], found: Any) -> bool:
    """What goes without saying: blocks for one output, nonlinear forms of a linear plant."""
    if form == "blocks":
        return found.plant.p == 1 or "linear" in present
    if form in ("chain", "triangular"):
        return found.plant.p > 1
    return form == "linear" and "state_affine" not in present and found.plant.m + found.plant.n > 1 and bool(present)


def _advice(found: Any, present: list[str], step: bool) -> list[str]:
    if step:
        return _wrapped("Designs in sampled time that need no form: lpv_lmi with lpv_from; observers DiscreteKalman.")
    said = "Designs that need no form: lpv_lmi and synthesize, with bounds on df/dx over a box from lpv_from"
    said += "." if all(k in ("0", "1", "c") for k in found.output.flat) else ", which asks for an output that is linear in x."
    lines = _wrapped(said)
    if found.plant.p == 1 and TIMED not in found.why.values() and not {"chain", "triangular"} & set(present):
        said = (
            "Other coordinates may help: jaxobs.structure.observability says where h and its derivatives along the flow tell "
            "the state, and jaxobs.structure.normal_form uses them as coordinates, in which it may be a chain or triangular."
        )
        lines += _wrapped(said)
    return lines


def _bounds(slopes: Any) -> list[str]:
    box = f"x from {slopes.states}" + (f", u from {slopes.inputs}" if len(slopes.inputs.lower) else "")
    if math.isfinite(slopes.constant) and slopes.jacobian.assumptions:
        said = f"For {box}, {slopes.of} has no Lipschitz constant that is proved."
    elif math.isfinite(slopes.constant):
        said = f"For {box}, {slopes.of} has the Lipschitz constant {slopes.constant:.6g}, proved by interval arithmetic."
    else:
        said = f"For {box}, nothing bounds {slopes.of}: take a smaller box."
    lines = _wrapped(said)
    if slopes.jacobian.assumptions:
        lines += _wrapped(f"Bounds on its slope take for granted: {'; '.join(slopes.jacobian.assumptions)}.")
    return lines
