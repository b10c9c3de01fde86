"""Paper 000: where the print is not reproduced, our number by another road."""

import math

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
from oracles import noise, polynomial, riccati

from jaxobs import papers
from jaxobs.papers.p000 import PICTURES, discrete, weights
from jaxobs.papers.pictures import Picture

ALPHAS, GAMMA, RHO = [3.0, 2.0], 6.0, 1.5


def row(name):
    return next(claim for claim in papers.load("000").claims if claim.name == name).check()


def pendulum(t, x):
    return [x[1], np.sin(x[0]) + 0.5 * np.sin(t) * np.cos(x[0])]


def normalised(gamma):
    """P^-1/2 Q P^-1/2 by a Riccati solver and a matrix root."""
    p, q = riccati.solve(ALPHAS, gamma)
    root = scipy.linalg.inv(scipy.linalg.sqrtm(p))
    return root @ q @ root


def matrix_62(x, gain, delta, epsilon):
    """(62), or with X = P^-1 / delta (63), which is to be negative definite: M and N of section 4."""
    a, c = np.eye(2) + delta * np.eye(2, k=1), np.eye(1, 2)
    m, n = np.diag([0, math.sqrt(RHO)]), np.diag([math.sqrt(RHO), 0])
    cross, zero = x @ (a - np.outer(gain, c)), np.zeros((2, 2))
    return np.block(
        [[epsilon * n.T @ n - x, cross.T, zero], [cross, -x, delta * x @ m], [zero, delta * m.T @ x, -epsilon * np.eye(2)]]
    )


def test_8_as_printed_is_not_the_product_with_the_mirror_image():
    alphas = [4.0, 6.0, 4.0, 1.0]
    assert weights.printed_weights(alphas) == polynomial.printed_weights(alphas).tolist() == [4, 16, 4, 1]
    assert polynomial.weights(alphas).tolist() == [4, 6, 4, 1]
    assert row("(8) q_i").verdict == "false as stated"


def test_10_as_printed_lets_a_negative_weight_pass():
    a = [1.0, 0.7, 0.24]
    assert np.roots([1, *a]).real.max() < 0
    assert a[0] ** 2 + 2 * (-a[1] + a[2] * a[0]) > 0  # i = 1, k = 1, 2
    assert a[1] ** 2 - 2 * a[2] * a[0] > 0  # i = 2, k = 2
    assert polynomial.weights(a)[0] == pytest.approx(row("(10)").ours) == pytest.approx(-0.4)


def test_10_excludes_some_poles():
    assert np.roots([1, 1, 1]).real.max() < 0
    assert polynomial.weights([1.0, 1.0])[0] == row("(10) pole placement").ours == -1


def test_26_is_no_constant():
    found = [riccati.parts(ALPHAS, gamma)[1] / 2 for gamma in (1.0, 6.0, 100.0)]
    assert found[0] > 1.07 * found[1] > 1.07 * found[2]
    assert found[2] == pytest.approx(row("(26) constant").ours, rel=1e-4) == pytest.approx(math.sqrt(9 / 7), rel=1e-4)


def test_30_does_not_follow_from_29():
    low, high = 0.659, 0.659 * 1.05
    slope = np.linalg.eigvalsh(normalised(high) - normalised(low))[0] / (high - low)
    sharp = np.linalg.eigvalsh(normalised(1.0))[0]
    assert slope == pytest.approx(row("(30)").ours, rel=1e-6)
    allowed = (slope + sharp) / 2
    for gamma in (low, high):  # (29) holds with this 1 / lambda_n
        assert np.linalg.eigvalsh(normalised(gamma) - gamma * allowed * np.eye(2))[0] > 0
    assert slope < allowed  # and (30) does not


def test_32_lacks_the_input():
    assert pendulum(np.pi / 2, [0.0, 0.0])[1] == pytest.approx(row("(32)").ours) == 0.5


def cost(beta, gamma):
    """The left side of (33), from e(0) = (0, 1)."""
    weights_ = beta / np.asarray([5 * GAMMA**2, 4 * GAMMA**4])

    def flow(t, z):
        x, xhat = z[:2], z[2:4]
        e = x - xhat
        drift = np.asarray(pendulum(t, xhat)) + np.asarray([3 * gamma, 2 * gamma**2]) * e[0]
        return [*pendulum(t, x), *drift, weights_ @ e**2 + e[0] ** 2]

    start = [1.0, 0.0, 1.0, -1.0, 0.0]
    return scipy.integrate.solve_ivp(flow, (0, 4), start, rtol=1e-10, atol=1e-14).y[-1, -1]


def test_33_bounds_and_does_not_minimize():
    left, right = riccati.parts(ALPHAS, GAMMA)
    beta = (left - RHO * right) * left
    found = row("Corollary 1: optimality")
    assert found.ours == pytest.approx(cost(beta, 2 * GAMMA) / cost(beta, GAMMA), rel=1e-3)
    assert found.ours < 1
    p, _ = riccati.solve(ALPHAS, GAMMA)
    assert cost(beta, GAMMA) < scipy.linalg.inv(p)[1, 1]
    assert row("(33)-(36) Corollary 1").verdict == "reproduced"


def test_48_lacks_a_root():
    p, _ = riccati.solve(ALPHAS)
    inverse = scipy.linalg.inv(p)
    push = np.linalg.norm(scipy.linalg.inv(scipy.linalg.sqrtm(p))[:, 0])
    largest = np.linalg.eigvalsh(inverse)[-1]
    assert push > largest
    assert row("(48) C2").ours == pytest.approx(push / largest)


def test_48_the_physical_noise_grows_with_gamma():
    for q in range(4):
        alphas = [math.comb(2 + q, k) for k in range(1, 3 + q)]
        at = [noise.white(np.asarray(alphas) * gamma ** np.arange(1.0, 3 + q), q)[q + 1, q + 1] for gamma in (4.0, 8.0)]
        assert at[1] / at[0] == pytest.approx(8, rel=1e-6)
    assert row("(48) level gamma^-q/2").ours == pytest.approx(1.5)


def test_48_so_does_a_tone_far_above_the_bandwidth():
    """Its answer in xhat_2 goes like gamma^{q+2}: for white noise and tones alike, the level does not fall with gamma."""
    for q in range(4):
        gains = []
        for gamma in (4.0, 8.0):
            f, b = noise.system(np.asarray([math.comb(2 + q, k) for k in range(1, 3 + q)]) * gamma ** np.arange(1.0, 3 + q), q)
            gains.append(abs(np.linalg.solve(1e4j * np.eye(2 + q) - f, b)[q + 1]))
        assert math.log2(gains[1] / gains[0]) == pytest.approx(q + 2, abs=0.01)
    assert "gamma^(2, 3, 4, 5)" in row("(48) level gamma^-q/2").why


def test_an_offset_passes():
    f, b = noise.system(np.asarray([4.0, 6.0, 4.0, 1.0]) * 6.0 ** np.arange(1.0, 5.0), 2)
    found = scipy.integrate.solve_ivp(lambda t, e: f @ e + b, (0, 10), np.zeros(4), method="BDF", rtol=1e-9, atol=1e-12)
    said = row("Corollary 2: decouples")
    assert abs(found.y[2, -1]) == pytest.approx(1, rel=1e-5)
    assert "an offset in y passes to xhat_1 with gain 1 " in said.why
    assert (said.verdict, said.ours) == ("reproduced", np.linalg.norm(b))  # for every gamma


@pytest.mark.slow
def test_the_printed_form_grows():
    """xi'' = x_1 beside the pendulum, by an adaptive solver."""

    def flow(t, z):
        return [*pendulum(t, z[:2]), z[3], z[0]]

    found = scipy.integrate.solve_ivp(flow, (0, 200), [1.0, 0.0, 0.0, 0.0], rtol=1e-11, atol=1e-11).y[2, -1]
    assert row("(37) growth").ours == pytest.approx(abs(found), rel=2e-3)


def test_44_needs_more_gamma_than_figure_3_may_have():
    alphas = [4.0, 6.0, 4.0, 1.0]
    left, right = riccati.parts(alphas, GAMMA)
    assert row("(44) figure 3").ours == pytest.approx(left - RHO * right, rel=1e-4)
    assert f"{riccati.smallest_gamma(alphas, RHO):.4f}" in row("(44) figure 3").why


def test_51_needs_the_estimate_in_phi():
    phi = [np.sin(x) + 0.5 * np.cos(x) for x in (0.2, 1.0)]
    assert row("(50)-(51) (54)").ours == pytest.approx(0.01 * (phi[0] - phi[1]))
    assert row("(50)-(51) (54)").verdict == "scan?"


def test_53_the_first_column_decides():
    p, _ = riccati.solve(ALPHAS, GAMMA)
    other = 0.0915 * p + np.diag([0, 1.0])
    assert np.linalg.eigvalsh(other)[0] > 0
    assert other[:, 0] == pytest.approx(0.0915 * p[:, 0], rel=1e-15)
    assert np.abs(scipy.linalg.inv(other) - scipy.linalg.inv(0.0915 * p)).max() > 1e-3
    assert row("(52)-(53)").verdict == "false as stated"


def test_57_has_a_wrong_sign():
    x, e = 2.0, 1.0
    after = e - e / x
    assert x * after**2 - x * e**2 == pytest.approx(-1.5)
    found = row("(56)-(57)")
    assert found.verdict == "slip"
    assert (e - e / x) * x * (e + found.ours * e / x) - x * e**2 == pytest.approx(-1.5)
    assert (e - e / x) * x * (e + e / x) - x * e**2 == pytest.approx(-0.5)


def test_64_needs_a_column():
    p, _ = riccati.solve(ALPHAS, GAMMA)
    assert (row("(64)").verdict, row("(64)").ours) == ("slip", np.atleast_2d(p[:, 0]).T.shape[1])


@pytest.mark.parametrize("delta", discrete.POINTS)
def test_62_the_printed_points(delta):
    epsilon, x = discrete.POINTS[delta]
    x = np.asarray(x)
    assert np.linalg.eigvalsh(matrix_62(x, scipy.linalg.inv(x)[:, 0], delta, epsilon))[-1] < 0
    assert row(f"(62) point, delta = {delta:g}").verdict == "reproduced"


def test_63_the_largest_period_in_closed_form():
    found = row("(63) (65) largest delta")
    assert found.ours == pytest.approx(43 / (2 * (144 + math.sqrt(8094))), rel=1e-6)
    assert found.verdict == "conservative"
    p, _ = riccati.solve(ALPHAS, GAMMA)

    def margin(delta):
        x, gain = scipy.linalg.inv(p) / delta, delta * p[:, 0]
        best = scipy.optimize.minimize_scalar(
            lambda s: np.linalg.eigvalsh(matrix_62(x, gain, delta, s))[-1], bounds=(1e-3, 0.1), method="bounded",
            options={"xatol": 1e-10},
        )  # fmt: skip
        return best.fun

    assert margin(0.09189) < 0 < margin(0.0919)
    at_printed = matrix_62(scipy.linalg.inv(p) / 0.0915, 0.0915 * p[:, 0], 0.0915, 0.0347)
    assert np.linalg.eigvalsh(at_printed)[-1] < 0
    assert row("(63) point, delta = 0.0915").verdict == row("(65) any smaller delta").verdict == "reproduced"


def test_65_is_not_symmetric_as_printed():
    p, _ = riccati.solve(ALPHAS, GAMMA)
    inverse, step = scipy.linalg.inv(p), np.eye(2, k=1) + np.eye(2) / 0.0915
    upper = step.T @ inverse - np.diag([1.0, 0])
    assert np.abs(upper.T - (step @ inverse - np.diag([1.0, 0]))).max() == pytest.approx(row("(65) entry (2,1)").ours)
    assert np.allclose(upper.T, inverse @ step - np.diag([1.0, 0]), rtol=0, atol=1e-12)


def test_68_the_sign():
    p, _ = riccati.solve(ALPHAS)
    assert scipy.linalg.inv(p)[1, 0] == pytest.approx(-1 / 7)
    assert row("(68) P^-1 (2,1)").verdict == "scan?"


@pytest.mark.parametrize(
    ("name", "printed"), [("(71) lambda_min", 3.5620), ("(71) 2 sqrt(p_nn lambda_max)", 2.2713), ("(71) largest rho", 1.5683)]
)
def test_71(name, printed):
    left, right = riccati.parts(ALPHAS, GAMMA)
    expected = {"(71) lambda_min": left, "(71) 2 sqrt(p_nn lambda_max)": right, "(71) largest rho": left / right}[name]
    assert row(name).ours == pytest.approx(expected, rel=1e-9) == pytest.approx(printed, abs=5e-5)


def test_rho_and_gamma_are_on_the_safe_side():
    angle, u = np.meshgrid(np.linspace(-4, 4, 4001), np.linspace(-0.5, 0.5, 101))
    assert row("rho = 3/2").ours == pytest.approx(np.max(np.cos(angle) - u * np.sin(angle)), rel=1e-5)
    assert row("rho = 3/2").verdict == "conservative"
    assert row("gamma = 6").ours == pytest.approx(riccati.smallest_gamma(ALPHAS, RHO), rel=1e-6)


@pytest.mark.slow
def test_the_ladder_by_frequency_responses():
    """A free P exists iff rho |N (sI - F)^-1 B| < 1 on the imaginary axis: N = I, or x_1 alone."""
    omega = np.linspace(0, 30, 300_001)
    for name, both in (("gamma = 6: S-lemma, free P", 1.0), ("gamma = 6: structure", 0.0)):
        gamma = row(name).ours
        polynomial_ = 2 * gamma**2 - omega**2 + 3j * gamma * omega
        peak = np.max(np.sqrt(1 + both * np.abs(1j * omega + 3 * gamma) ** 2) / np.abs(polynomial_))
        assert RHO * peak == pytest.approx(1, rel=1e-5)
        assert row(name).verdict == "conservative"


@pytest.mark.slow
def test_the_rows_on_noise_say_what_was_found():
    open_, false = row("noise at equal settling time"), row("noise at equal squared error")
    assert (open_.verdict, false.verdict) == ("open", "false as stated")
    numbers = [float(x) for x in false.ours.removesuffix(" of (3, 2)").split(", ")]
    assert numbers == pytest.approx([math.sqrt(27 / 64 / (2 / 3 * (11 / 12) ** 3))] * 4, abs=6e-4)
    # Equal gamma and equal abscissa: c = 1/4, 1/16, 1/32, 5/256 against 2/3.
    expected = [math.sqrt(1.5 * c) for c in (1 / 4, 1 / 16, 1 / 32, 5 / 256)]
    for name in ("noise at equal gamma", "noise at equal spectral abscissa", "noise at equal gamma, measured"):
        numbers = [float(x) for x in row(name).ours.removesuffix(" of (3, 2)").split(", ")]
        assert numbers == pytest.approx(expected, rel=0.05 if "measured" in name else 5e-3)


@pytest.mark.parametrize("draw", PICTURES[:3], ids=lambda draw: draw.__name__)
def test_figures(draw):
    picture = draw()
    assert isinstance(picture, Picture)
    for panel in picture.panels:
        truth, estimate = (np.asarray(line.y) for line in panel.lines)
        assert np.all(np.isfinite(truth))
        assert np.sqrt(np.mean((truth - estimate)[1000:] ** 2)) < 0.15
