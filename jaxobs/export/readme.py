"""The README beside exported code."""

from typing import Any

import equinox as eqx

from jaxobs._version import __version__
from jaxobs.export.c_file import sizes
from jaxobs.export.coverage import Coverage
from jaxobs.export.straight import Straight
from jaxobs.export.tick import Tick

HEAD = """# {name}

A state observer written by jaxobs {version}: {counts}, in {real}.

    {observer}

One sample is one call, every period: the estimate that uses the measurement of this sample comes back, and the state moves on
to the next one. NaN in the measurement marks a lost sample, whose innovation is {lost}.

## What is proved

{proof}
"""
C = """
## C99

`{name}.c` and `{name}.h` need nothing but `math.h`: no allocation, no global state, no recursion, a fixed number of operations
for every sample. Of each observed plant keep one `{name}_state`.

```c
{name}_state state;
{name}_start(&state, xhat0);                  /* once */
{name}_update(&state, {u}y, xhat);            /* every sample */
```

Compile with `-std=c99`, without `-ffast-math` (lost samples are NaN). `-ffp-contract=off`, which `-std=c99` implies in GCC,
makes it equal to `{name}.py` bit for bit but for the functions of the mathematical library. The test vectors:

```sh
cc -std=c99 -O2 {name}.c {name}_test.c -lm -o {name}_test && ./{name}_test < {name}_vectors.csv
```

It fails beyond {allowed:.3g} ulps, units in the last place of the largest number that each state takes in the vectors: XLA
sums in another order and has functions of its own. `{name}.py` was within {off:.3g} ulps of JAX when this was written.{clock}
"""
NUMPY = """
## NumPy

`{name}.py` has `state = start(xhat0)` and `state, xhat = step(k, state, u, y)` on NumPy scalars; k = 0, 1, ... counts samples.
"""
STABLEHLO = """
## StableHLO

`{name}_start.stablehlo` and `{name}_step.stablehlo` are files of `jax.export`; their arguments and results, flat and in
order, are in `{name}_stablehlo.json`. In Python:

```python
import pathlib
import jax
step = jax.export.deserialize(pathlib.Path("{name}_step.stablehlo").read_bytes()).call
```

`.mlir_module()` of what is read is the module as text, for runtimes without Python.
"""
CLOCK = """

The model depends on time, which is counted in samples by an `int32_t` that stays at its largest value once it gets there."""


def readme(
    name: str, tick: Tick, code: Straight | None, covered: Coverage, kinds: tuple[str, ...], off: float, allowed: float
) -> str:
    """What is in the folder, how it is called, and what is proved of it."""
    observer: Any = tick.observer
    proof = [covered.sentence]
    if covered.certificate is not None:
        data = covered.certificate.to_dict()
        proof += [f"Certificate `{name}.certificate.json`, theorem {data['theorem']}, SHA-256 {data['sha256']}:", data["claim"]]
        proof += ["It takes for granted:", "\n".join(f"- {one}" for one in data["assumptions"])]
        against = f" --against {name}.c" if "c" in kinds else ""
        proof += [
            "It was proved anew, in exact arithmetic, for the gain as it stands in these files. Check it again:",
            f"    jaxobs verify {name}.certificate.json{against}",
        ]
    lost = "that of the last sample that came" if tick.hold_innovation else "zero"
    real = "float" if code is not None and code.real.itemsize == 4 else "double"
    shown = "\n    ".join(eqx.tree_pformat(observer, short_arrays=False).splitlines())
    text = HEAD.format(
        name=name, version=__version__, counts=sizes(observer), real=real, observer=shown, lost=lost, proof="\n\n".join(proof)
    )
    clock = CLOCK if code is not None and code.uses_k else ""
    if "c" in kinds:
        text += C.format(name=name, u="u, " if observer.m else "", off=off, allowed=allowed, clock=clock)
    if "numpy" in kinds:
        text += NUMPY.format(name=name)
    return text + (STABLEHLO.format(name=name) if "stablehlo" in kinds else "")
