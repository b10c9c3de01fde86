"""All files of an exported observer, in one folder."""

import dataclasses
import json
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from jaxobs._module import astype, dtype_of, refuse
from jaxobs._version import __version__
from jaxobs.export import stablehlo as hlo
from jaxobs.export.c_file import c_files, require_name
from jaxobs.export.coverage import Certificate, Coverage, coverage
from jaxobs.export.numpy_file import NumpyStep, numpy_file
from jaxobs.export.readme import readme
from jaxobs.export.straight import Straight, straight
from jaxobs.export.tick import Tick
from jaxobs.export.vectors import Vectors, csv_text, test_program, ulps, vectors
from jaxobs.observers import AbstractStepObserver

FORMAT = "jaxobs-export/1"
PRECISIONS = ("float32", "float64")
LARGEST = 64.0  # ulps that the test program allows at least: another libm, another order of sums in XLA
ASTRAY = 2.0**20  # ulps between straight-line code and JAX that no order of sums explains
KINDS = ("c", "numpy", "stablehlo")


@dataclasses.dataclass(frozen=True)
class Exported:
    """files: what was written, by what it is; coverage: what is proved; state: the numbers that go on to the next sample."""

    files: dict[str, Path]
    coverage: Coverage
    state: int


def export(
    observer: AbstractStepObserver,
    out: str | PathLike[str],
    *,
    name: str = "observer",
    precision: str | None = None,
    certificate: Certificate | None = None,
    kinds: tuple[str, ...] = KINDS,
    hold_innovation: bool = False,
    xhat0: Any = None,
    ys: Any = None,
    us: Any = None,
    samples: int = 1000,
    platforms: tuple[str, ...] = ("cpu",),
) -> Exported:
    """Writes one sample of a step observer, `Tick`, with its parameters as constants, into the folder `out`:

        c          NAME.c and NAME.h, C99 without allocation or dependency but math.h; NAME_test.c, NAME_vectors.csv
        numpy      NAME.py, which needs NumPy alone
        stablehlo  NAME_start.stablehlo and NAME_step.stablehlo of jax.export, NAME_stablehlo.json with their arguments

    and README.md; beside them NAME.certificate.json, `certificate` proved anew, in exact arithmetic, for the gain in the code.

    name: a C identifier. precision: "float32" or "float64", that of the observer if not given. xhat0, ys (T, p), us (T, m): the
    record of the test vectors, its first `samples` rows; small random numbers if not given. platforms: of StableHLO.
    ValueError for bad arguments; Unsupported for an operation that cannot be written as straight-line code; Infeasible if the
    rounded gain is no longer proved. Nothing is written then.
    """
    require_name(name)
    tick = Tick(_in_precision(observer, precision), hold_innovation)
    wrong = [kind for kind in kinds if kind not in KINDS]
    if wrong or not kinds:
        raise refuse("export", "kinds", kinds, f"some of {', '.join(KINDS)}", "Each is written beside the others.")
    code = straight(tick) if set(kinds) & {"c", "numpy"} or certificate is not None else None
    covered = coverage(tick.observer, code.tables if code is not None else {}, certificate)
    about, texts, off, allowed = _about(covered), {}, 0.0, LARGEST
    if code is not None and "c" in kinds:
        made = c_files(code, name, about)
        compared = vectors(tick, count=samples, xhat0=xhat0, ys=ys, us=us)
        off = _checked(code, compared)
        unit, allowed = np.spacing(np.max(np.abs(compared.xhat), axis=0)), max(LARGEST, 4 * off)
        texts |= {"source": (f"{name}.c", made.source), "header": (f"{name}.h", made.header)}
        program = test_program(name, code.n, code.m, code.p, allowed, unit)
        texts |= {"test": (f"{name}_test.c", program), "vectors": (f"{name}_vectors.csv", csv_text(compared))}
    if code is not None and "numpy" in kinds:
        texts["numpy"] = (f"{name}.py", numpy_file(code, name, about))
    parts = hlo.stablehlo(tick, platforms) if "stablehlo" in kinds else None
    if parts is not None:
        convention = {"format": FORMAT, "jaxobs": __version__, "platforms": list(platforms), "call": hlo.CALL}
        convention |= {key: _signature(one) for key, one in zip(("start", "step"), parts, strict=True)}
        texts["convention"] = (f"{name}_stablehlo.json", json.dumps(convention, indent=2) + "\n")
    texts["readme"] = ("README.md", readme(name, tick, code, covered, kinds, off, allowed))
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    files = {}
    for what, (file, text) in texts.items():
        files[what] = folder / file
        files[what].write_text(text, encoding="utf-8")
    for what, one in zip(("start", "step"), parts or (), strict=False):
        files[f"stablehlo {what}"] = folder / f"{name}_{what}.stablehlo"
        files[f"stablehlo {what}"].write_bytes(one.serialize())
    if covered.certificate is not None:
        files["certificate"] = folder / f"{name}.certificate.json"
        covered.certificate.to_json(files["certificate"])
    return Exported(files, covered, len(code.dtypes) if code is not None else 0)


def _checked(code: Straight, compared: Vectors) -> float:
    """How many ulps the straight-line code is from JAX on the vectors. ValueError where they diverge, or differ by far."""
    finite = np.all(np.isfinite(compared.xhat), axis=1)
    if not np.all(finite):
        fix = "Give ys, us and xhat0 of the plant, or another gain: the estimate diverges on these."
        raise refuse("export", "ys", f"samples with an infinite estimate at {int(np.argmin(finite))}", "finite estimates", fix)
    step, found = NumpyStep(code, numpy_file(code, "observer")), []
    state = step.start(compared.xhat0)
    for k, (u, y) in enumerate(zip(compared.us, compared.ys, strict=True)):
        state, xhat = step(k, state, u, y)
        found.append(xhat)
    off = ulps(np.array(found), compared.xhat)
    if not off < ASTRAY:
        fix = "Errors of rounding grow in this observer, or this is a mistake of jaxobs: compare numpy_step(observer) with it."
        raise refuse("export", "observer", f"code that ends {off:.3g} ulps from JAX", "the same numbers but for rounding", fix)
    return off


def _in_precision(observer: Any, precision: str | None) -> Any:
    if precision is None:
        return observer
    if precision not in PRECISIONS:
        raise refuse("export", "precision", repr(precision), " or ".join(map(repr, PRECISIONS)), "That of the controller.")
    made = astype(observer, np.dtype(precision))
    if isinstance(observer, AbstractStepObserver) and np.dtype(dtype_of(made)).name != precision:
        fix = "Switch it on first: jax.config.update('jax_enable_x64', True)."
        raise refuse("export", "precision", repr(precision), "a precision that JAX has", fix)
    return made


def _about(covered: Coverage) -> str:
    """What a file says of its proof."""
    if covered.certificate is None:
        return covered.sentence
    data = covered.certificate.to_dict()
    return f"certificate: {data['theorem']} sha256 {data['sha256']}\n{data['claim']}\n{covered.sentence}"


def _signature(one: Any) -> dict[str, list[str]]:
    return {"in": [str(aval.str_short()) for aval in one.in_avals], "out": [str(aval.str_short()) for aval in one.out_avals]}
