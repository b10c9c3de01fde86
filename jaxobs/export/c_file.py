"""An observer as one C99 file and its header: no allocation, no dependency but math.h."""

import hashlib
import re
import textwrap
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from jaxobs._module import refuse
from jaxobs._version import __version__
from jaxobs.export.c_language import HELPERS, TYPES, C
from jaxobs.export.lines import Operand, Ref
from jaxobs.export.straight import Function, Straight
from jaxobs.export.writing import Text

SEAL = "sha256 of all below this comment"


class CFiles(NamedTuple):
    """The texts of NAME.h and NAME.c."""

    header: str
    source: str


class Layout(NamedTuple):
    """Where the entries of z are in the struct: fields (type, name, count), and the place of each entry."""

    fields: tuple[tuple[str, str, int], ...]
    places: tuple[str, ...]


def require_name(name: str) -> None:
    """A C identifier that is no keyword of ours: the prefix of all that the files define."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name):
        fix = "It is the prefix of everything in the C files, e.g. name='tracker'."
        raise refuse("export", "name", repr(name), "a letter, then letters, digits or _, 31 at most", fix)


def layout(code: Straight) -> Layout:
    """Floats in z, other types in arrays of their own."""
    counts: Counter[str] = Counter()
    places = []
    for dtype in code.dtypes:
        field = "z" if dtype == code.real else f"z_{dtype.name}"
        places.append(f"s->{field}[{counts[field]}]")
        counts[field] += 1
    types = {"z": "real"} | {f"z_{dtype.name}": TYPES[dtype.name] for dtype in code.dtypes if dtype != code.real}
    return Layout(tuple((types[field], field, count) for field, count in counts.items()), tuple(places))


def c_files(code: Straight, name: str, about: str) -> CFiles:
    """`about`: what is said of certificate and theorem at the head of the source."""
    require_name(name)
    where, real, single = layout(code), f"{name}_real", code.real == np.float32
    state = [f"    {real if kind == 'real' else kind} {field}[{count}];" for kind, field, count in where.fields]
    state += ["    int32_t k; /* the sample's number, from 0 */"] if code.uses_k or not state else []
    inputs = f"const {real} u[{code.m}], " if code.m else ""
    prototypes = (
        f"void {name}_start({name}_state *s, const {real} xhat0[{code.n}])",
        f"void {name}_update({name}_state *s, {inputs}const {real} y[{code.p}], {real} xhat[{code.n}])",
    )
    header = _header(name, code, "float" if single else "double", state, prototypes)
    language = C(code.real)
    start = _body(language, code.start, {"xhat0": cells("xhat0", code.n)}, list(where.places), code)
    start += ["    s->k = 0;"] if code.uses_k or not where.places else []
    places = {"z": list(where.places), "k": ["s->k"], "u": cells("u", code.m), "y": cells("y", code.p)}
    places |= {key: cells(key, value.size) for key, value in code.tables.items()}
    targets = [*where.places, *cells("xhat", code.n)]
    update = _body(language, code.step, places, targets, code)
    update += ["    if (s->k < INT32_MAX) s->k += 1;"] if code.uses_k else []
    unused = [one for one in ("u", "y") if getattr(code, "m" if one == "u" else "p") and not _reads(update, one)]
    update = [f"    (void){one};" for one in unused] + update
    helpers = [HELPERS[key] for key in sorted(language.helpers)]
    parts = [f'#include "{name}.h"', "#include <math.h>", GUARDS, f"typedef {real} real;", *_tables(code), *helpers]
    shown = [one.replace(f"const {real} ", "const real ").replace(f" {real} ", " real ") for one in prototypes]
    parts += [f"{shown[0]}\n{{\n{chr(10).join(start)}\n}}", f"{shown[1]}\n{{\n{chr(10).join(update)}\n}}"]
    code_text = "\n\n".join(parts) + "\n"
    seal = hashlib.sha256(code_text.encode()).hexdigest()
    title = f"{name}: a state observer of {sizes(code)}, in {'float' if single else 'double'}. Written by jaxobs {__version__}."
    said = [part for line in about.replace("*/", "* /").replace("/*", "/ *").splitlines() for part in textwrap.wrap(line, 116)]
    comment = "\n".join(f" * {line}".rstrip() for line in [title, "", *said, "", f"{SEAL}: {seal}"])
    return CFiles(header, f"/*\n{comment}\n */\n{code_text}")


GUARDS = """#ifdef __FAST_MATH__
#error "lost samples are NaN: compile without -ffast-math"
#endif
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif"""


def sizes(code: Any) -> str:
    """In words: of anything with n, m and p."""
    counts = zip((code.n, code.m, code.p), ("state", "input", "output"), strict=True)
    return ", ".join(f"{count} {word}{'' if count == 1 else 's'}" for count, word in counts)


def cells(name: str, count: int) -> list[str]:
    """The entries of an array, as C and Python write them."""
    return [f"{name}[{i}]" for i in range(count)]


def _reads(lines: list[str], name: str) -> bool:
    return any(re.search(rf"\b{name}\[", line) for line in lines)


def _tables(code: Straight) -> list[str]:
    """In hexadecimal, where every digit is exact; in decimal beside it."""
    tables = []
    for key, value in code.tables.items():
        suffix = "f" if code.real == np.float32 else ""
        rows = [f"    {float(x).hex()}{suffix}, /* {x} */" for x in value.reshape(-1)]
        shape = f"/* {' x '.join(map(str, value.shape))}, row by row */\n" if value.ndim > 1 else ""
        tables.append(f"{shape}static const real {key}[{value.size}] = {{\n" + "\n".join(rows) + "\n};")
    return tables


def _body(language: C, function: Function, places: dict[str, list[str]], targets: list[str], code: Straight) -> list[str]:
    """The lines, then all results at once: a result may still be read for another one, and y may be xhat in memory."""
    text = Text(language, function.lines, function.results, places)
    lines, ends = list(text.body), []
    types = [*code.dtypes, *[code.real] * code.n]
    for i, (one, target) in enumerate(zip(function.results, targets, strict=False)):
        written = text.operand(one)
        if not _is_local(one, text):
            lines.append(language.define(f"next{i}", types[i], written))
            written = f"next{i}"
        ends.append(f"{target} = {written};")
    return [f"    {line}" for line in [*lines, *ends]]


def _is_local(one: Operand, text: Text) -> bool:
    return (isinstance(one, Ref) and one.number not in text.inline) or isinstance(one, np.generic)


def _header(name: str, code: Straight, kind: str, state: list[str], prototypes: tuple[str, ...]) -> str:
    guard = f"{name.upper()}_H"
    inputs = "u: the inputs held from this sample on. " if code.m else ""
    return f"""/* {name}: a state observer of {sizes(code)}. Written by jaxobs {__version__}; see {name}.c. */
#ifndef {guard}
#define {guard}

#include <stdint.h>

#define {name.upper()}_STATES {code.n}
#define {name.upper()}_INPUTS {code.m}
#define {name.upper()}_OUTPUTS {code.p}

typedef {kind} {name}_real;

/* All that goes from one sample to the next; one for each plant that is observed. */
typedef struct {{
{chr(10).join(state)}
}} {name}_state;

#ifdef __cplusplus
extern "C" {{
#endif

/* From the first guess xhat0; nothing else need be initialised. */
{prototypes[0]};

/* One sample, once every period. {inputs}y: the measurement, NaN where it was lost (its innovation is then
 * zero). xhat: the estimate that uses this y. Pointers may be equal; no input leads to undefined behaviour. */
{prototypes[1]};

#ifdef __cplusplus
}}
#endif

#endif
"""
