"""Exported code against the Python step: C99, NumPy and StableHLO, for every observer of the package."""

import importlib.util
import json
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import CASES
from exported import STRICT, Compiled, compiled

from jaxobs import observers, plants
from jaxobs.export import NumpyStep, Tick, Unsupported, export, numpy_step, read_c, straight, ulps, vectors
from jaxobs.export.c_file import c_files
from jaxobs.export.numpy_file import numpy_file
from jaxobs.integrators import RK4
from jaxobs.observers import AbstractFlowObserver, AbstractStepObserver

QUICK = ("DiscreteKalman", "IntegralHighGain", "InnerInjection", "StepIntegral q=0")
OBSERVERS = [name for name in CASES if isinstance(CASES[name](jnp.float64), AbstractFlowObserver | AbstractStepObserver)]
REFUSED = ("PulledBack", "PulledBack q=1", "PulledBack gain")  # a linear solve in every step
DIVERGE = {"Lyapunov": 300, "Lyapunov blocks": 300}  # of noise alone their gains grow: fewer samples
SLOW_ROUNDING = {"StepIntegral": 400.0, "DiscreteAlgebraic": 160.0}  # poles near 1 keep errors of rounding
MOST = 64.0  # ulps of full scale, between C and Python, over 10,000 samples
FUNCTIONS = 8.0  # ulps between two libraries of sines and exponentials; without them C equals NumPy bit for bit


def made(name, dtype):
    observer = CASES[name](lambda value: jnp.asarray(value, dtype))
    if isinstance(observer, AbstractFlowObserver):
        observer = observers.Sampled(observer, RK4(), jnp.asarray(0.01, dtype))
    return observer


def written(code, name, folder):
    files = c_files(code, name, "No certificate.")
    (folder / f"{name}.c").write_text(files.source)
    (folder / f"{name}.h").write_text(files.header)
    return Compiled(folder, name, code)


def compare(name, dtype, count, folder):
    """The C code over `count` samples: against Python to some ulps, against NumPy on the first 300 exactly."""
    tick = Tick(made(name, dtype))
    code = straight(tick)
    expected = vectors(tick, count=min(count, DIVERGE.get(name, count)))
    controller = written(code, "observer", folder)
    controller.start(expected.xhat0)
    found = np.array([controller.update(u, y) for u, y in zip(expected.us, expected.ys, strict=True)])
    assert np.all(np.isfinite(expected.xhat))
    assert found.dtype == expected.xhat.dtype
    assert ulps(found, expected.xhat) <= SLOW_ROUNDING.get(name, MOST)
    step, by_numpy = NumpyStep(code, numpy_file(code, "observer")), []
    state = step.start(expected.xhat0)
    for k in range(min(300, len(found))):
        state, xhat = step(k, state, expected.us[k], expected.ys[k])
        by_numpy.append(xhat)
    exact = not any(f"np.{one}(" in step.source for one in ("sin", "cos", "exp", "log", "power", "exp2", "tanh"))
    assert ulps(found[: len(by_numpy)], np.array(by_numpy)) <= (0.0 if exact else FUNCTIONS)


@pytest.mark.parametrize("name", QUICK)
def test_c_code_is_the_python_step(name, tmp_path):
    compare(name, np.float64, 10_000, tmp_path)


def test_c_code_is_the_python_step_in_float32(tmp_path):
    compare("IntegralHighGain", np.float32, 10_000, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", [one for one in OBSERVERS if one not in REFUSED])
def test_c_code_is_the_python_step_for_every_observer(name, dtype, tmp_path):
    compare(name, dtype, 10_000, tmp_path)


def test_what_cannot_be_written_is_refused_by_name():
    with pytest.raises(Unsupported, match="uses 'lu'; expected operations on numbers with a fixed order"):
        straight(Tick(made("PulledBack", np.float64)))


def coupled(x, u):
    """Branches, loops over arrays and by count, an index by the loop's own count: all that JAX offers for control flow."""
    weights = jnp.asarray([0.1, -0.2, 0.3])
    total = jax.lax.fori_loop(0, 3, lambda i, s: s + weights[i] * x[0] ** (i + 1), jnp.zeros(()))
    last, path = jax.lax.scan(lambda s, w: (s * 0.5 + w, s), x[1], weights)
    turned = jax.lax.cond(x[0] > 0.1, lambda v: jnp.sin(v), lambda v: v - 0.05, x[0])
    chosen = jax.lax.switch(jnp.asarray(jnp.floor(3 * x[1]), jnp.int32), [lambda: 0.1, lambda: 0.2, lambda: -0.1])
    halved = jax.lax.fori_loop(0, 7, lambda i, s: 0.5 * s + 0.01 * i, x[1])
    return jnp.stack(
        [0.9 * x[0] + 0.1 * x[1] + 0.1 * u[0], 0.5 * x[1] + 0.1 * (total + last + path[1] + turned) + chosen + halved]
    )


def first(x, u):
    return x[0]


def lookup(x, u):
    return 0.5 * jnp.asarray([0.1, 0.2, 0.3, 0.4])[jnp.asarray(3 * x[0], jnp.int32)] * x


def halves(x, u):
    return 0.5 * x + 0.1 * x.astype(jnp.float16).astype(x.dtype)


def counting(x, u):
    """Whole numbers, negative ones too: in C they wrap around as in JAX."""
    turns = jnp.asarray(1e3 * x[0], jnp.int32) * jnp.asarray(-7, jnp.int32) - jnp.asarray(2**31 - 1, jnp.int32)
    return jnp.stack([0.9 * x[0] + 0.1 * u[0], 0.5 * x[1] + 1e-10 * turns.astype(x.dtype)])


def searching(x, u):
    return jax.lax.while_loop(lambda v: jnp.sum(v * v) > 1, lambda v: 0.5 * v, x)


def stepping(function):
    return observers.StepLuenberger(plants.from_step_function(function, first, n=2, m=1), [[0.5], [0.2]])


def test_control_flow_is_written_out(tmp_path):
    tick = Tick(stepping(coupled))
    code, expected = straight(tick), vectors(tick, count=500)
    controller = written(code, "flow", tmp_path)
    controller.start(expected.xhat0)
    found = np.array([controller.update(u, y) for u, y in zip(expected.us, expected.ys, strict=True)])
    assert ulps(found, expected.xhat) <= MOST
    assert "for (int turn1 = 0; turn1 < 7; ++turn1)" in (tmp_path / "flow.c").read_text()


@pytest.mark.parametrize(
    ("function", "primitive"), [(lookup, "gather|dynamic_slice"), (searching, "while"), (halves, "convert")]
)
def test_control_flow_that_depends_on_data_is_refused_by_name(function, primitive):
    with pytest.raises(Unsupported, match=f"uses '({primitive})'") as caught:
        straight(Tick(stepping(function)))
    assert "StableHLO" in str(caught.value)


def test_whole_numbers_wrap_around(tmp_path):
    tick = Tick(stepping(counting))
    expected = vectors(tick, count=200)
    controller = written(straight(tick), "counts", tmp_path)
    controller.start(expected.xhat0)
    found = np.array([controller.update(u, y) for u, y in zip(expected.us, expected.ys, strict=True)])
    assert ulps(found, expected.xhat) <= MOST


@pytest.fixture(scope="module")
def tracker(tmp_path_factory):
    """All files of a tracker with one integrator, in float."""
    folder = tmp_path_factory.mktemp("tracker")
    observer = observers.DiscreteTracker(2, 1, 40.0, 1 / 120)
    return observer, folder, export(observer, folder, name="tracker", precision="float32")


def test_the_test_program_passes_and_notices_a_change(tracker, tmp_path):
    _, folder, _ = tracker
    values = (folder / "tracker_vectors.csv").read_text()

    def run(text):
        return subprocess.run([compiled(folder, "tracker", program=True)], input=text, capture_output=True, text=True)

    assert run(values).returncode == 0
    assert run(values).stdout.startswith("1000 samples, within ")
    lines = values.splitlines()
    lines[20] = ",".join([*lines[20].split(",")[:-1], "0.5"])
    assert run("\n".join(lines)).returncode == 1
    assert run("").returncode == 2


def test_the_header_is_one_for_cpp_too(tracker, tmp_path):
    (tmp_path / "use.cpp").write_text(
        '#include "tracker.h"\nint main() { tracker_state s; (void)s; return TRACKER_STATES - 2; }\n'
    )
    command = ["c++", "-Wall", "-Wextra", "-Werror", "-I", tracker[1], tmp_path / "use.cpp", "-o", tmp_path / "use"]
    assert subprocess.run(command, capture_output=True).returncode == 0
    assert subprocess.run([tmp_path / "use"]).returncode == 0


@pytest.mark.parametrize("name", ["StepLyapunov", "IntegralHighGain"])
def test_no_input_is_undefined_behaviour(name, tmp_path):
    """Under the sanitizers: infinite, NaN, tiny and huge numbers, from states that such numbers left behind."""
    code = straight(Tick(made(name, np.float32)))
    files = c_files(code, "wild", "No certificate.")
    (tmp_path / "wild.c").write_text(files.source)
    (tmp_path / "wild.h").write_text(files.header)
    u = "u, " if code.m else ""
    (tmp_path / "main.c").write_text(f"""
#include <math.h>
#include <stdint.h>
#include <string.h>
#include "wild.h"
static float wild(uint32_t *seed)
{{
    static const float some[] = {{0.0f, -0.0f, 1.0f, -3.4e38f, 3.4e38f, 1e-45f, 1e20f}};
    *seed = *seed * 1664525u + 1013904223u;
    float x;
    memcpy(&x, seed, sizeof x); /* any pattern of bits */
    switch (*seed >> 28) {{
        case 0: return NAN;
        case 1: return INFINITY;
        case 2: return some[(*seed >> 8) % 7];
        default: return x;
    }}
}}
int main(void)
{{
    wild_state state;
    uint32_t seed = 1;
    float u[{max(code.m, 1)}], y[{code.p}], xhat[{code.n}];
    for (int i = 0; i < 20000; ++i) {{
        for (int j = 0; j < {code.n}; ++j) xhat[j] = wild(&seed);
        if (i % 50 == 0) wild_start(&state, xhat);
        for (int j = 0; j < {code.m}; ++j) u[j] = wild(&seed);
        for (int j = 0; j < {code.p}; ++j) y[j] = wild(&seed);
        (void)u;
        wild_update(&state, {u}y, xhat);
    }}
    return 0;
}}
""")
    checks = ["-fsanitize=undefined,address,float-cast-overflow", "-fno-sanitize-recover=all"]
    build = [*STRICT, *checks, tmp_path / "wild.c", tmp_path / "main.c", "-lm", "-o", tmp_path / "wild"]
    made_of = subprocess.run(["cc", *map(str, build)], capture_output=True, text=True)
    assert made_of.returncode == 0, made_of.stderr
    ran = subprocess.run([tmp_path / "wild"], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


def test_stablehlo_is_read_back_and_does_the_same(tracker):
    observer, folder, made_of = tracker
    start, step = (jax.export.deserialize((folder / f"tracker_{one}.stablehlo").read_bytes()) for one in ("start", "step"))
    convention = json.loads((folder / "tracker_stablehlo.json").read_text())
    assert [str(one.str_short()) for one in step.in_avals] == convention["step"]["in"]
    tick = Tick(jax.tree.map(lambda leaf: leaf.astype(np.float32), observer))
    state = start.call(jnp.zeros(2, np.float32))
    expected = vectors(tick, count=50)
    found = []
    for k in range(50):
        *state, xhat = step.call(*state, jnp.asarray(k, jnp.int32), jnp.zeros(0, np.float32), jnp.asarray(expected.ys[k]))
        found.append(xhat)
    assert ulps(np.array(found), expected.xhat) <= 2
    assert made_of.files["stablehlo step"].exists()


def test_the_numpy_file_needs_numpy_alone(tracker):
    _, folder, _ = tracker
    text = (
        "import sys; sys.modules['jax'] = sys.modules['jaxobs'] = None\n"
        f"sys.path.insert(0, {str(folder)!r})\n"
        "import numpy as np, tracker\n"
        "state = tracker.start(np.zeros(2, np.float32))\n"
        "for k in range(3): state, xhat = tracker.step(k, state, (), np.array([0.5], np.float32))\n"
        "assert xhat.dtype == np.float32 and xhat.shape == (2,) and 'jax' not in str(type(xhat)); print(xhat[0])\n"
    )
    ran = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    spec = importlib.util.spec_from_file_location("tracker_file", folder / "tracker.py")
    assert spec is not None
    assert "Written by jaxobs" in (folder / "tracker.py").read_text()


def test_what_is_said_of_a_proof_cannot_leave_its_comment(tmp_path):
    """The origin of bounds is anybody's sentence: it ends neither the comment in C nor the docstring in Python."""
    code = straight(Tick(made("StepIntegral q=0", np.float64)))
    about = 'bounds: given */ int x = 1; /* by """ hand, \\N{sign} and ' + "a long story " * 30
    files = c_files(code, "observer", about)
    (tmp_path / "observer.c").write_text(files.source)
    (tmp_path / "observer.h").write_text(files.header)
    compiled(tmp_path, "observer")
    assert read_c(tmp_path / "observer.c").whole
    assert max(map(len, files.source.partition("*/")[0].splitlines())) <= 128
    assert NumpyStep(code, numpy_file(code, "observer", about)).start(np.zeros(2)) == (0, 0)


def test_a_held_innovation_is_exported_as_observe_has_it():
    observer = made("HighGain", np.float64)
    tick = Tick(observer, hold_innovation=True)
    step = numpy_step(observer, hold_innovation=True)
    rng = np.random.default_rng(0)
    us, ys = rng.normal(size=(40, 1)), rng.normal(size=(40, 1))
    ys[5:9], ys[20] = np.nan, np.nan
    state, expected = step.start(np.zeros(2)), vectors(tick, count=40, ys=ys, us=us)
    for k in range(40):
        state, xhat = step(k, state, us[k], ys[k])
        np.testing.assert_allclose(xhat, expected.xhat[k], rtol=1e-12, atol=1e-14)
    without = vectors(Tick(observer), count=40, ys=ys, us=us)
    assert np.max(np.abs(without.xhat[10] - expected.xhat[10])) > 1e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "9lives"}, r"export\.name: given '9lives'; expected a letter"),
        ({"kinds": ("fortran",)}, r"export\.kinds: given \('fortran',\); expected some of c, numpy, stablehlo"),
        ({"precision": "float16"}, r"export\.precision: given 'float16'"),
        ({"xhat0": [0.0]}, r"export\.xhat0: given shape \(1,\); expected \(2,\)"),
        ({"ys": np.zeros((5, 2))}, r"export\.ys: given shape \(5, 2\); expected \(T, 1\)"),
        ({"ys": np.full((5, 1), 1e308)}, r"export\.ys: given samples with an infinite estimate"),
        ({"platforms": ("abacus",)}, r"export\.platforms: given \('abacus',\)"),
    ],
)
def test_bad_arguments_are_named_and_nothing_is_written(change, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        export(observers.DiscreteTracker(2, 0, 40.0, 1 / 120), tmp_path / "out", **change)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("as_users_have_it")
def test_a_flow_observer_is_told_to_be_sampled(tmp_path):
    with pytest.raises(ValueError, match=r"Tick\.observer: given HighGain .* Wrap a flow observer: jaxobs\.observers\.Sampled"):
        export(CASES["HighGain"](jnp.float64), tmp_path)
