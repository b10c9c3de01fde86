"""designs.slopes: exact for functions without derivative, along one coordinate at a time."""

from fractions import Fraction

import numpy as np
import pytest

from jaxobs.designs import auxiliary, slopes


def saturation(v):
    return min(max(v, -1), 1)


def dead_zone(v):
    return v - saturation(v)


@pytest.mark.parametrize(
    ("f", "low", "high"),
    [(abs, -1, 1), (saturation, 0, 1), (dead_zone, 0, 1)],
)
def test_slopes_of_functions_without_derivative_are_exact(f, low, high):
    rng = np.random.default_rng(1)
    for pair in rng.integers(-24, 25, (100, 2, 3)):
        x, z = (np.array([Fraction(int(v), 8) for v in one], dtype=object) for one in pair)

        def psi(v):
            return f(v[0]) - 3 * f(v[1] + v[2]) + f(v[2])

        bounds = [[low, high], [-3 * high, -3 * low], [low - 3 * high, high - 3 * low]]
        found = slopes(psi, x, z, bounds)
        assert psi(x) - psi(z) == sum(a * b for a, b in zip(found, x - z, strict=True))
        # the same by hand: one coordinate at a time
        y = list(x)
        for j in range(3):
            before = psi(y)
            y[j] = z[j]
            if x[j] != z[j]:
                assert found[j] == (before - psi(y)) / (x[j] - z[j])
        assert y == list(auxiliary(x, z, 3))


def test_slopes_where_points_agree_and_bounds_that_fail():
    assert slopes(lambda v: v[0] ** 2, [1.0, 2.0], [1.0, 3.0], [[2.0, 5.0], [-1.0, 1.0]]).tolist() == [2.0, 0.0]
    assert slopes(lambda v: v[0] ** 2, [1.0], [1.0]).tolist() == [0.0]
    with pytest.raises(ValueError, match=r"slopes\.bounds: given \[-1\.0, 1\.0\] with psi_1 = 3 .*expected bounds that hold"):
        slopes(lambda v: v[0] ** 2, [1.0], [2.0], [[-1.0, 1.0]])
    with pytest.raises(ValueError, match=r"lowest <= highest"):
        slopes(lambda v: v[0], [1.0], [2.0], [[1.0, -1.0]])
    with pytest.raises(ValueError, match=r"slopes\.bounds: given shape \(2,\); expected shape \(1, 2\)"):
        slopes(lambda v: v[0], [1.0], [2.0], [0.0, 1.0])
    with pytest.raises(ValueError, match=r"auxiliary\.z"):
        auxiliary([1.0, 2.0], [1.0], 0)
    with pytest.raises(ValueError, match=r"auxiliary\.i: given 3"):
        auxiliary([1.0, 2.0], [1.0, 1.0], 3)


def test_slopes_of_a_map_form_a_matrix():
    a = np.array([[1.0, -2.0], [0.5, 4.0], [0.0, 1.0]])
    assert np.allclose(slopes(lambda v: a @ v, [1.0, 2.0], [-3.0, 0.5]), a)
