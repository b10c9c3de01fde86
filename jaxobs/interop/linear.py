"""Linear systems of python-control (the extra `control`), both ways: x' = A x + B u, y = C x, or x+ with a period dt."""

import functools
from typing import Any

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np

from jaxobs._module import Numbers, concrete, dtype_of, refuse, require_instance
from jaxobs.observers import AbstractFlowObserver, AbstractStepObserver
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant, Linear, LinearStep

Subject = AbstractFlowPlant | AbstractStepPlant | AbstractFlowObserver | AbstractStepObserver


def from_control(system: Any) -> Linear | LinearStep:
    """`Linear(A, B, C)` of a continuous, `LinearStep` of a discrete system: a StateSpace, or a TransferFunction, which becomes
    one in control.ss's coordinates.

    ValueError for D != 0 (no plant here feeds its input through: subtract D u from y), for complex matrices, and for what is no
    linear system.
    """
    control = _control("from_control")
    if isinstance(system, control.TransferFunction):
        system = control.ss(system)
    if not isinstance(system, control.StateSpace):
        fix = "Linearise it first: control.linearize(system, x, u)."
        raise refuse("from_control", "system", type(system).__name__, "a StateSpace or a TransferFunction", fix)
    a, b, c, d = (np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D))
    if any(np.iscomplexobj(matrix) for matrix in (a, b, c)):
        raise refuse("from_control", "system", "complex matrices", "real ones", "Split real and imaginary parts.")
    if np.any(d):
        fix = "Observe y - D u, of which both parts are known."
        raise refuse("from_control", "system", f"D = {d.tolist()}", "D = 0", fix)
    kind = Linear if system.dt in (None, 0) else LinearStep
    return kind(jnp.asarray(a), jnp.asarray(b) if b.shape[1] else None, jnp.asarray(c))


def to_control(subject: Subject, *, x: Numbers | None = None, u: Numbers | None = None, dt: Any = None) -> Any:
    """control.StateSpace of a plant, u -> y, or of an observer, (u, y) -> xhat, linearised at (x, u), zeros if not given:

        A = df/dx,  B = df/du,  C = dh/dx,  D = dh/du,      exact for linear ones.

    For an observer x is its whole state z, flattened, f its flow or step, h its estimate, and y is the output that its model
    predicts there. dt [s]: the period of a step plant or observer; that of the observer, if it has one, else True, "some
    period". ValueError for a (x, u) that does not fit.
    """
    control = _control("to_control")
    require_instance("to_control", "subject", subject, Subject, "Give a plant or an observer.")
    dtype = dtype_of(subject)
    inputs = _vector("u", u, subject.m, dtype)
    time = jnp.zeros((), dtype)
    index = jnp.zeros((), jnp.result_type(int))
    if isinstance(subject, AbstractFlowPlant | AbstractStepPlant):
        state = _vector("x", x, subject.n, dtype)
        move, when = (subject.flow, time) if isinstance(subject, AbstractFlowPlant) else (subject.step, index)
        f, h, names = functools.partial(move, when), subject.h, {}
    else:
        state, inputs, f, h = _observer(subject, x, inputs, time, index, dtype)
        outputs = [f"y[{i}]" for i in range(subject.p)]
        names = {"inputs": [*(f"u[{i}]" for i in range(subject.m)), *outputs]}
    matrices = [np.asarray(jax.jacfwd(g, argnums=k)(state, inputs), float) for g in (f, h) for k in (0, 1)]
    flows = isinstance(subject, AbstractFlowPlant | AbstractFlowObserver)
    own = concrete(getattr(subject, "dt", None)) if hasattr(subject, "dt") else None
    period = 0 if flows else dt if dt is not None else True if own is None else float(own)
    return control.ss(*matrices, period, **names)


def _observer(subject: Any, x: Any, u: Any, time: Any, index: Any, dtype: Any) -> tuple[Any, Any, Any, Any]:
    """State, input (u, y), and the maps of an observer, its pytree of a state flattened."""
    start = subject.init(jnp.zeros((subject.n,), dtype))
    flat, back = jax.flatten_util.ravel_pytree(start)
    state = flat if x is None else _vector("x", x, flat.shape[0], dtype)
    when = time if isinstance(subject, AbstractFlowObserver) else index
    move = subject.flow if isinstance(subject, AbstractFlowObserver) else subject.step
    y = subject.predict(when, back(state), u)

    def f(z: Any, w: Any) -> Any:
        return jax.flatten_util.ravel_pytree(move(when, back(z), w[: subject.m], w[subject.m :]))[0]

    def h(z: Any, w: Any) -> Any:
        return subject.estimate(when, back(z), w[: subject.m], w[subject.m :])

    return state, jnp.concatenate([u, y]), f, h


def _vector(field: str, value: Any, size: int, dtype: Any) -> Any:
    found = jnp.zeros((size,), dtype) if value is None else jnp.asarray(value, dtype)
    if found.shape != (size,):
        raise refuse("to_control", field, f"shape {found.shape}", f"({size},)", "One number for each.")
    return found


def _control(owner: str) -> Any:
    try:
        import control
    except ImportError as error:
        message = f"{owner}: python-control is not installed; it is the extra `control`: pip install 'jaxobs[control]'."
        raise ImportError(message) from error
    return control
