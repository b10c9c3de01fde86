"""Gramians against scipy and closed forms, the conditions of paper 003 on inputs whose answer is known, and what is refused."""

import numpy as np
import pytest
from oracles import lyapunov as oracle
from scipy.linalg import block_diag, eigh
from scipy.special import comb

from jaxobs import excitation, plants
from jaxobs.excitation.gramian import Gramians, fading_gramians, pair_of, window_gramians

NONE = np.zeros(0)
GATED = plants.GatedChain()
MOTOR, CRAFT = plants.FieldMotor(), plants.Hovercraft()
# numbers that the trend of alpha, gamma and c cannot hide behind
STEADY = {"horizon": (2.0, 14.0), "thetas": (4.0, 8.0, 16.0)}


def motor_input(t):
    return [1 + 0.8 * np.sin(2 * t), 0.0]


def craft_input(t):
    return [np.cos(t), t / 2]


def motor_a(u):
    return np.diag([-2 * u[0], -2.0], 1)


def craft_a(u):
    a = np.zeros((5, 5))
    a[:2, 2:4] = np.eye(2)
    a[2:4, 4] = u[0] * np.cos(u[1]), u[0] * np.sin(u[1])
    return a


@pytest.mark.parametrize(
    ("plant", "u", "a", "c"),
    [(MOTOR, motor_input, motor_a, np.eye(1, 3)), (CRAFT, craft_input, craft_a, np.eye(2, 5))],
)
def test_gramians_equal_scipy(plant, u, a, c):
    pair, t, theta = pair_of("test", plant, u), 2.5, 3.0
    window = window_gramians(pair, np.asarray([t]), theta, NONE).full()[0, 0]
    expected = oracle.gramian(a, c, u, t - 1 / theta, t)
    d = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(window / np.outer(d, d), expected / np.outer(d, d), atol=1e-8)
    fading = fading_gramians(pair, np.linspace(0, t, 61), np.asarray([theta, 10.0])).full()[-1]
    for rate, ours in zip((theta, 10.0), fading, strict=True):
        expected = oracle.gramian(a, c, u, 0.0, t, rate)
        d = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(ours / np.outer(d, d), expected / np.outer(d, d), atol=1e-8)


def test_figures_equal_their_definitions():
    """alpha, gamma and c from the roots, against generalised eigenvalues of the full matrices, with blocks."""
    pair = pair_of("test", CRAFT, craft_input)
    gramians = fading_gramians(pair, np.linspace(0, 3.0, 41), np.asarray([3.0, 6.0]))
    for r in range(2):
        psi = gramians.full()[-1, r]
        parts = [psi[:2, :2], psi[2:4, 2:4], psi[4:, 4:]]
        alpha = eigh(block_diag(*parts), psi, eigvals_only=True)[-1]
        assert gramians.coupling()[-1, r] == pytest.approx(alpha, rel=1e-8)
        large, small = [np.linalg.norm(p, 2) for p in parts], [np.linalg.norm(np.linalg.inv(p), 2) for p in parts]
        gamma = max(small[j] * large[i] for i in range(3) for j in range(i + 1))
        assert gramians.spread()[-1, r] == pytest.approx(gamma, rel=1e-9)
        assert gramians.smallest()[-1, r] == pytest.approx(np.linalg.eigvalsh(psi)[0], rel=1e-6)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_chain_in_closed_form(n):
    """Psi_ij = (-1)^{i+j} C(i+j-2, i-1) / theta^{i+j-1} once the start is forgotten; G of (11) is a Hilbert matrix."""
    theta, pair = 8.0, pair_of("test", plants.IntegratorChain(n), lambda t: NONE)
    psi = fading_gramians(pair, np.linspace(0, 12.0, 200), np.asarray([theta])).full()[-1, 0]
    i, j = np.mgrid[1 : n + 1, 1 : n + 1]
    expected = (-1.0) ** (i + j) * comb(i + j - 2, i - 1)
    np.testing.assert_allclose(psi * theta ** (i + j - 1), expected, rtol=1e-9)
    factorial = np.cumprod([1.0, *range(1, n)])
    window = window_gramians(pair, np.asarray([2.0]), theta, NONE).full()[0, 0] * theta ** (i + j - 1)
    expected = (-1.0) ** (i + j) / ((i + j - 1) * factorial[i - 1] * factorial[j - 1])
    np.testing.assert_allclose(window, expected, rtol=1e-9)


def test_a_constant_input_in_closed_form():
    found = excitation.classify(GATED, lambda t: 2.0, horizon=(6.0, 16.0), thetas=(4.0, 8.0, 16.0))
    assert found.alpha.worst == pytest.approx(2 + np.sqrt(2), rel=1e-6)  # 1 / (1 - 1/sqrt 2), once the start is forgotten
    scaled = np.diag([1.0, 2.0]) @ np.array([[1, 1 / 2], [1 / 2, 1 / 3]]) @ np.diag([1.0, 2.0])
    assert found.regularity.worst == pytest.approx(np.linalg.eigvalsh(scaled)[0], rel=1e-9)
    assert found.gamma.worst[-1] == pytest.approx(1.0)
    assert found.lowest == found.lower == found.upper == 2.0
    assert found.locally_regular
    assert found.persistent
    assert found.constant_gain
    assert "a finite grid proves nothing" in found.why


def test_a_simple_zero_of_the_input():
    """Near a zero u is linear: q = c a - a^2/2, under the law e^{-a}, correlates by sqrt(2/3) at most: alpha = 3 + sqrt 6."""
    found = excitation.classify(GATED, np.cos, **STEADY)
    assert found.alpha.worst[1:] == pytest.approx(3 + np.sqrt(6), rel=1e-5)
    assert found.regularity.power(found.thetas) == pytest.approx(-2, abs=0.05)
    assert not found.locally_regular
    assert found.persistent
    assert not found.constant_gain
    assert found.sign_changes.tolist() == [True]


def test_a_zero_at_the_end_of_a_window():
    """The worst window of (11) for a simple zero in its middle, by brute force."""
    found = excitation.classify(GATED, np.cos, **STEADY)
    theta, ends = 16.0, np.pi / 2 + 2 * np.pi + np.linspace(-0.02, 0.1, 61)
    values = []
    for t in ends:
        g = oracle.gramian(lambda u: np.array([[0, u], [0, 0]]), np.eye(1, 2), np.cos, t - 1 / theta, t)
        values.append(np.linalg.eigvalsh(g * np.outer([theta, theta**2], [theta, theta**2]) / theta)[0])
    assert found.regularity.worst[-1] == pytest.approx(min(values), rel=1e-2)


def test_jumps_are_cut():
    """sign(cos t): a triangle in the middle of a window, in closed form."""
    jumps = np.pi * (np.arange(6) + 0.5)
    found = excitation.classify(GATED, lambda t: np.sign(np.cos(t)), breaks=jumps, **STEADY)

    def window(delta):  # q rises for delta, then falls: moments of (1, q) over [0, 1]
        first = delta**2 / 2 + (1 - delta) * (2 * delta) - (1 - delta**2) / 2
        second = delta**3 / 3 + (delta**3 + (1 - 2 * delta) ** 3) / 3
        return np.linalg.eigvalsh([[1, -first], [-first, second]])[0]

    expected = min(window(delta) for delta in np.linspace(0, 1, 2001))
    assert found.regularity.worst == pytest.approx(expected, rel=1e-4)
    assert found.locally_regular
    assert found.persistent
    assert not found.constant_gain
    assert found.lowest == 1.0


def test_a_lost_state_is_seen_in_logarithms():
    """A bump, then nothing: Psi_22 underflows, yet alpha tends to 1, as it is defined to."""
    pair = pair_of("test", GATED, lambda t: float(t < 1))
    grid = np.unique(np.concatenate([np.linspace(0, 60.0, 481), [1.0]]))
    gramians = fading_gramians(pair, grid, np.asarray([16.0]))
    assert gramians.full()[-1, 0, 1, 1] == 0.0
    assert gramians.logs[-1, 0, 1] == pytest.approx(-16.0 * 59 / 2 + gramians.logs[grid == 1.0][0, 0, 1], rel=1e-9)
    assert gramians.coupling()[-1, 0] == pytest.approx(1.0, abs=1e-12)


def test_what_is_never_seen_is_singular():
    gramians = fading_gramians(pair_of("test", GATED, lambda t: 0.0), np.linspace(0, 2.0, 17), np.asarray([4.0]))
    assert np.all(np.isinf(gramians.coupling()[1:]))
    assert np.all(np.isinf(gramians.spread()[1:]))
    assert np.all(gramians.smallest() == 0)


def test_three_states_and_blocks():
    motor = excitation.classify(MOTOR, lambda t: [np.cos(t), 0.0], **STEADY)
    assert not motor.locally_regular
    assert motor.persistent
    assert motor.sign_changes.tolist() == [True, False]
    assert motor.lower[1] == motor.upper[1] == -2.0
    assert motor.lowest[1] == 2.0
    craft = excitation.classify(CRAFT, craft_input, **STEADY)
    assert craft.persistent
    assert not craft.constant_gain
    assert craft.lowest.size == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"plant": plants.Lorenz()}, ("classify.plant", "Lorenz", "pair(u)")),
        ({"thetas": (4.0, 8.0)}, ("classify.thetas", "three or more")),
        ({"thetas": (4.0, 8.0, 8.0)}, ("classify.thetas", "increasing")),
        ({"horizon": (0.1, 5.0)}, ("classify.horizon", "1/theta")),
        ({"horizon": (5.0, 2.0)}, ("classify.horizon", "t_0 < T")),
        ({"u": lambda t: [1.0, 2.0]}, ("classify.u", "(2,)", "(1,)")),
    ],
)
def test_refused(change, words):
    given = {"plant": GATED, "u": np.cos, **STEADY} | change
    plant, u = given.pop("plant"), given.pop("u")
    with pytest.raises(ValueError, match="given") as error:
        excitation.classify(plant, u, **given)
    assert all(word in str(error.value) for word in words), str(error.value)


def test_two_outputs_want_blocks():
    class TwoOutputs(plants.AbstractStateAffine):
        n, m, p = 2, 0, 2

        def a(self, u):
            raise NotImplementedError

        b = c = a

    with pytest.raises(ValueError, match="AbstractBlockTriangular"):
        excitation.classify(TwoOutputs(), lambda t: NONE, **STEADY)


def boxes(n):
    return np.full(n, -3.0), np.full(n, 3.0)


def test_structure_of_good_plants():
    found = excitation.structure(MOTOR, states=boxes(3), inputs=([0.5, -1.0], [1.5, 1.0]))
    assert found.uniformly_observable
    assert found.lower.tolist() == [-3.0, -2.0]
    assert found.upper.tolist() == [-1.0, -2.0]
    exact = np.array([[2.0, 0, 0], [3.0, 1.0, 0], [0, 0, 0]])  # 1 = (0.2 / 0.5 + 0.1) / 0.5 at standstill
    assert np.all(found.slopes <= exact)
    np.testing.assert_allclose(found.slopes, exact, rtol=0.05)
    assert excitation.structure(plants.SineChain(), states=boxes(5)).uniformly_observable


class NotTriangular(plants.AbstractTriangular):
    n, m = 3, 0

    def a(self, u):
        return np.ones(2)

    def g(self, x, u):
        return x[2] * x[::-1] * 0 + x.at[0].set(x[2] ** 2)


class AlmostTriangular(plants.AbstractTriangular):
    """The coupling vanishes for no u, but depends on the state."""

    n, m = 2, 0

    def a(self, u):
        return np.ones(1)

    def g(self, x, u):
        return x.at[0].set(-x[0] * x[1] * 0.5).at[1].set(0.0)


@pytest.mark.parametrize(
    ("plant", "inputs", "why"),
    [
        (GATED, ([-0.5], [1.0]), "dF_1/dx_2 changes its sign"),
        (GATED, ([0.0], [1.0]), "dF_1/dx_2 vanishes"),
        (CRAFT, ([0.0, 0.0], [1.0, 1.0]), "dF_2/dx_3 loses rank"),
        (plants.Lorenz(), None, "y is not x_1"),
        (NotTriangular(), None, "not triangular: dF_1/dx_3"),
        (AlmostTriangular(), None, "dF_1/dx_2 changes its sign"),
    ],
)
def test_structure_names_what_is_wrong(plant, inputs, why):
    found = excitation.structure(plant, states=boxes(plant.n), inputs=inputs)
    assert not found.uniformly_observable
    assert why in found.why


def test_g_not_triangular_is_refused():
    with pytest.raises(ValueError, match=r"g_i of x_1, \.\.\., x_i alone"):
        excitation.require_triangular("test", NotTriangular())
    with pytest.raises(ValueError, match=r"structure\.states"):
        excitation.structure(GATED, states=([0.0], [1.0]), inputs=([0.0], [1.0]))


def test_results_are_plain_data():
    found = excitation.classify(GATED, lambda t: 1.0, **STEADY)
    assert isinstance(found.alpha.worst, np.ndarray)
    assert found.alpha.halves.shape == (3, 2)
    assert found.count > 12 * 16
    assert isinstance(fading_gramians(pair_of("test", GATED, np.cos), np.linspace(0, 1, 3), np.ones(1)), Gramians)
