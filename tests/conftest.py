"""Every test runs in float64, with strict promotion, shapes and types checked at run time, and warnings as errors."""

import signal

import jax
import jaxtyping
import pytest
from hypothesis import settings

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
settings.register_profile("jaxobs", deadline=None, derandomize=True)
settings.load_profile("jaxobs")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as shells start what they run in the background: Ctrl-C is tested too
    signal.signal(signal.SIGINT, signal.default_int_handler)
HOOK = jaxtyping.install_import_hook("jaxobs", "beartype.beartype")


@pytest.fixture
def as_users_have_it():
    """Without run-time type checks: a wrong shape then meets the package's own message, as it does for a user."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="module")
def hardly_optimised():
    """For modules whose cost is compiling: programs that run once or twice."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)
