"""What importing costs and touches, each time in a fresh interpreter."""

import subprocess
import sys

import jaxobs


def in_fresh_interpreter(code: str) -> str:
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


LOWER = (
    "linalg", "hurwitz", "signals", "noise", "integrators", "plants", "observers",
    "observe", "simulate", "score", "differentiate", "metrics", "certificates", "datasets",
)  # fmt: skip


def test_running_needs_none_of_the_heavy_packages():
    heavy = ["cvxpy", "xarray", "zarr", "matplotlib", "optax", "tyro", "rich"]
    code = f"import sys, jaxobs\n[getattr(jaxobs, name) for name in {LOWER}]\nprint([m for m in {heavy} if m in sys.modules])"
    assert in_fresh_interpreter(code) == "[]"


def test_importing_is_quick():
    """In processor time, half of what jax and diffrax take: a ratio within one run, since machines differ and are shared."""
    code = f"""
import time
start = time.process_time()
import jax, diffrax
theirs = time.process_time() - start
import jaxobs
[getattr(jaxobs, name) for name in {LOWER}]
print((time.process_time() - start) / theirs - 1)
"""
    assert float(in_fresh_interpreter(code)) < 0.5


def test_importing_sets_nothing():
    code = f"""
import os, jax
before, environment = dict(jax.config.values), dict(os.environ)
import jaxobs
[getattr(jaxobs, name) for name in {LOWER}]
print(dict(jax.config.values) == before, dict(os.environ) == environment)
"""
    assert in_fresh_interpreter(code) == "True True"


def test_every_name_on_offer_resolves():
    assert "__version__" in dir(jaxobs)
    assert {"observe", "simulate", "grid", "over", "plants", "observers", "designs"} <= set(dir(jaxobs))
    for name in dir(jaxobs):
        assert getattr(jaxobs, name) is not None


def test_an_unknown_name_is_an_attribute_error():
    assert not hasattr(jaxobs, "no_such_thing")
