"""Charts: decode and encode are inverse, land where they should, and have slopes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import hurwitz
from jaxobs.tuning import Affine, Box, LogQ, Lyapunov, PoleSector, Positive, decode, encode

CHARTS = {
    "log q": (LogQ(), [2.5, 3.0, 0.7]),
    "sector": (PoleSector(0.3, 0.5), [6.0, 13.0, 12.0]),
    "sector, two real poles": (PoleSector(0.5, 0.1), [3.0, 2.0]),
    "half plane": (PoleSector(), [3.0, 2.0, 1.0, 0.4]),
    "positive": (Positive(), [[0.2, 3.0], [40.0, 1e-3]]),
    "box": (Box([0.0, -2.0], 5.0), [1.0, 4.9]),
    "affine": (Affine([1.0, 2.0], [0.5, -3.0]), [-4.0, 10.0]),
    "lyapunov": (Lyapunov(2), [[2.0, -0.5], [-0.5, 1.0]]),
}


@pytest.mark.parametrize("name", CHARTS)
def test_decode_inverts_encode(name):
    chart, value = CHARTS[name]
    theta = chart.encode(value)
    assert np.allclose(jax.jit(lambda theta: chart.decode(theta))(theta), value, rtol=1e-9, atol=1e-12)
    back = chart.encode(chart.decode(theta + 0.1))
    assert np.allclose(back, theta + 0.1, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("name", CHARTS)
def test_slopes_are_those_of_finite_differences(name):
    chart, value = CHARTS[name]
    theta = chart.encode(value)
    direction = jnp.cos(jnp.arange(theta.size, dtype=theta.dtype)).reshape(theta.shape)
    decode_ = jax.jit(lambda theta: chart.decode(theta))
    step = 1e-5
    found = jax.jvp(decode_, (theta,), (direction,))[1]
    expected = (decode_(theta + step * direction) - decode_(theta - step * direction)) / (2 * step)
    assert np.allclose(found, expected, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("theta", [[0.3, -1.0, 0.2, 2.0, -0.5], [2.0, 3.0, -3.0, -4.0, 1.0]])
def test_poles_of_a_sector_lie_in_it(theta):
    damping, slowest = 0.6, 1.5
    roots = np.roots([1.0, *PoleSector(damping, slowest).decode(jnp.asarray(theta))]) + slowest
    assert np.all(roots.real < 0)
    assert np.all(-roots.real >= damping * np.abs(roots) * (1 - 1e-9))


def test_moved_poles():
    alphas = jnp.asarray([5.0, 8.0, 6.0])
    assert np.allclose(np.sort_complex(np.roots([1.0, *hurwitz.moved(alphas, jnp.asarray(0.7))])),
                       np.sort_complex(np.roots([1.0, *np.asarray(alphas)]) - 0.7), atol=1e-9)  # fmt: skip


def test_a_tree_of_charts():
    charts = {"alphas": LogQ(), "rest": {"gamma": Positive()}}
    values = {"alphas": [3.0, 2.0], "rest": {"gamma": 6.0}}
    found = decode(charts, encode(charts, {"alphas": jnp.asarray([3.0, 2.0]), "rest": {"gamma": jnp.asarray(6.0)}}))
    assert np.allclose(found["alphas"], values["alphas"])
    assert np.allclose(found["rest"]["gamma"], 6.0)


@pytest.mark.parametrize(
    ("chart", "value", "match"),
    [
        (LogQ(), [1.0, 5.0], r"LogQ.value: given \[1.0, 5.0\]; expected Hurwitz coefficients with \(10\)"),
        (LogQ(), [-3.0, 2.0], "LogQ.value"),
        (PoleSector(0.9), [1.0, 5.0], "PoleSector.value: .* poles with damping > 0.9"),
        (PoleSector(0.0, 3.0), [3.0, 2.0], "PoleSector.value"),
        (Positive(), [1.0, -1.0], "Positive.value: .* positive numbers"),
        (Box(0.0, 1.0), 1.0, "Box.value: .* strictly between"),
        (Lyapunov(2), [[1.0, 2.0], [2.0, 1.0]], "Lyapunov.value: .* a matrix > 0"),
        (Lyapunov(2), [[1.0]], r"Lyapunov.value: given shape \(1, 1\)"),
    ],
)
def test_values_outside_are_refused(chart, value, match):
    with pytest.raises(ValueError, match=match):
        chart.encode(value)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: PoleSector(1.0), "PoleSector.damping: given 1.0; expected a number in"),
        (lambda: PoleSector(0.5, -1.0), "PoleSector.slowest"),
        (lambda: Box(1.0, 1.0), "Box.lower: .* lower < upper"),
        (lambda: Affine(0.0, [1.0, 0.0]), "Affine.scale: .* other than 0"),
    ],
)
def test_charts_refuse_what_they_cannot_be(make, match):
    with pytest.raises(ValueError, match=match):
        make()
