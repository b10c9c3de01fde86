"""`jaxobs design`: observers for a plant, by every design that applies, side by side and with proofs."""

import json
import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from jaxobs.cli import screen

INTERVAL = re.compile(r"([xu])(\d+)=([^:]+):([^:]+)")


def design(
    plant: Annotated[str, tyro.conf.Positional],
    within: tuple[str, ...] = (),
    rate: float | None = None,
    noise: float = 0.1,
    process: float = 1.0,
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("designs"),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Observers z' = f(z, u) + L (y - h(z)) for a plant, by every design that applies, all proved at one decay rate, in the
    order of the noise that is guaranteed. The bounds on the slopes of f are proved too, by interval arithmetic. Exit code 0 if
    one is proved, 1 if none is, 2 if the plant or an option does not fit.

    Args:
        plant: FILE.py:NAME for one of yours (`jaxobs init plant` writes one), or the name of one of the package.
        within: where states and inputs stay, --within x1=-4:4 u1=-0.5:0.5; nothing bounds those that are left out. The more is
            known, the smaller the gains.
        rate: decay of the error that all are to prove [1/s], for step plants the factor a step; if not given, that of the
            plant's fastest growth, at least 1.
        noise: of the measurement, as the square root of its intensity: sigma sqrt(dt) for samples of sigma every dt seconds.
        process: the same of the disturbance that enters where the plant says.
        out: folder of the certificates, one for each design, made if missing.
        as_json: print the result as JSON on standard output instead.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.cli.parts import Reader
    from jaxobs.designs import survey
    from jaxobs.plants import AbstractPlant
    from jaxobs.structure import forms

    try:
        made = Reader().part(AbstractPlant, "a plant", {"name": plant}, "plant").build({}, {})
        states, inputs = bounds(within, made.n, made.m)
        shape = forms(made)
        with screen.waiting("bounds on the slopes") as say:
            found = survey(
                made,
                states,
                inputs=inputs if made.m else None,
                rate=rate,
                noise=noise * np.eye(made.p),
                process=process * np.asarray(made.disturbance_matrix(), float),
                progress=say,
            )
        out.mkdir(parents=True, exist_ok=True)
        rows = [_row(one, found, out) for one in found.candidates]
    except (OSError, ValueError) as error:
        hint = " Here: --within x1=-2:2 u1=-1:1, one for each that matters." if "nothing bounds" in str(error) else ""
        return screen.complain(f"{plant}: {error}{hint}")
    best = found.best
    told: dict[str, Any] = {"plant": plant, "form": str(shape), "rate": found.rate, "bounds": found.lpv.origin}
    told |= {
        "folder": str(out),
        "parameters": list(found.lpv.parameters),
        "designs": rows,
        "best": None if best is None else best.name,
    }
    if best is None and found.absence is not None:
        place = out / "absence.json"
        found.absence.to_json(place)
        told |= {"absence": str(place), "absence_claim": found.absence.claim}
    if as_json:
        print(json.dumps(told, indent=2))
    else:
        _show(told, any(row["level"] is not None for row in rows))
    return 0 if best is not None else 1


def bounds(within: tuple[str, ...], n: int, m: int) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """((lower, upper) of x, (lower, upper) of u) from texts like x1=-4:4. ValueError for what is none, or no such variable."""
    ends = {"x": (np.full(n, -np.inf), np.full(n, np.inf)), "u": (np.full(m, -np.inf), np.full(m, np.inf))}
    for text in within:
        found = INTERVAL.fullmatch(text)
        fix = "For example --within x1=-4:4 u1=-0.5:0.5."
        if found is None:
            raise ValueError(f"--within: given {text!r}; expected NAME=LOW:HIGH. {fix}")
        kind, k = found[1], int(found[2])
        count = n if kind == "x" else m
        if not 1 <= k <= count:
            there = f"{kind}1 to {kind}{count}" if count else f"no {kind}"
            raise ValueError(f"--within: given {kind}{k}; expected {there}, which this plant has. {fix}")
        try:
            low, high = float(found[3]), float(found[4])
        except ValueError:
            raise ValueError(f"--within: given {text!r}; expected two numbers. {fix}") from None
        if not low <= high:
            raise ValueError(f"--within: given {text!r}; expected LOW <= HIGH. {fix}")
        ends[kind][0][k - 1], ends[kind][1][k - 1] = low, high
    return ends["x"], ends["u"]


def _row(one: Any, found: Any, out: Path) -> dict[str, Any]:
    """One design as data; its certificate is written, with the proof of its bounds where plain arithmetic repeats it."""
    if one.certificate is None:
        return {
            "design": one.name,
            "gain": None,
            "level": None,
            "reason": one.reason,
            "change": one.change,
            "certificate": None,
        }
    place = out / f"{one.name}.json"
    try:
        carried, travels = found.travelling(one.certificate), True
    except ValueError:
        carried, travels = one.certificate, False
    carried.to_json(place)
    row: dict[str, Any] = {"design": one.name, "gain": one.gain.tolist(), "level": one.level, "certificate": str(place)}
    return row | {"bounds_travel": travels, "claim": one.certificate.claim}


def _show(told: dict[str, Any], leveled: bool) -> None:
    console = screen.console(stderr=False)

    def line(text: str) -> None:
        console.print(text, markup=False, highlight=False, soft_wrap=True)

    line(told["form"])
    line(f"\nslopes: {told['bounds']}")
    line(f"all proved at the rate {told['rate']:.4g}{' /s' if leveled else ' a step'}:\n")
    header = ["design", "gain L", *(["guaranteed rms of e"] if leveled else []), f"in {told['folder']}"]
    rows = []
    for row in (one for one in told["designs"] if one["gain"] is not None):
        gain = " ".join("(" + ", ".join(f"{x:.4g}" for x in column) + ")" for column in np.array(row["gain"]).T)
        level = [] if not leveled else [f"{np.sqrt(row['level']):.4g}"]
        rows.append([row["design"], gain, *level, Path(row["certificate"]).name + ("" if row["bounds_travel"] else " *")])
    if rows:
        screen.print_table(console, (header, rows))
    if any(not one.get("bounds_travel", True) for one in told["designs"]):
        line(
            "* the bounds are proved here and assumed in the file: bound the states by --within, and their proof travels along"
        )
    for row in (one for one in told["designs"] if one["gain"] is None):
        line(f"{row['design']}: not certified: {row['reason']}. {row['change']}")
    if told["best"] is not None:
        best = next(row for row in told["designs"] if row["design"] == told["best"])
        kind = "Luenberger" if leveled else "StepLuenberger"
        line(f"\nto use it: jaxobs.observers.{kind}(plant, jaxobs.certificates.load({best['certificate']!r}).gain)")
        line(f"to check it: jaxobs verify {best['certificate']}")
    elif "absence" in told:
        line(f"no constant gain can do it: {told['absence_claim']}\nthe proof: {told['absence']}")
