"""Paper 001: wherever the print and the recomputation differ, the recomputed value by another route (tests/oracles)."""

import functools
import math

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import sympy
from oracles import algebraic as oracle
from oracles import tracker as loops

from jaxobs import papers


@functools.cache
def row(name):
    (claim,) = [claim for claim in papers.load("001").claims if claim.name == name]
    return claim.check()


def differs(name, ours, rel_tol=1e-6, verdict="false as stated"):
    found = row(name)
    assert found.verdict == verdict
    assert math.isclose(found.ours, ours, rel_tol=rel_tol), f"{found.ours} by the package, {ours} here"


def test_8_the_integral_over_tau_diverges_and_that_over_s_is_h_infinity():
    differs("(8) integral", scipy.integrate.quad(lambda tau: math.exp(2 * tau), 0, 10, limit=200)[0])
    n, q, mu = 2, 1, 2.0
    a, _ = oracle.structure(n, q)

    def integrand(s):
        c = np.eye(3)[0] @ (np.eye(3) - a * s + a @ a * s**2 / 2)
        return math.exp(-mu * s) * np.outer(c, c)

    whole = scipy.integrate.quad_vec(integrand, 0, 40)[0]
    assert np.allclose(whole, oracle.h_infinity(n, q, mu), rtol=1e-7)


def test_15_the_step_fails_along_the_small_eigenvector_but_the_bound_holds():
    h = oracle.h_infinity(2, 1, 1.0)
    values, vectors = np.linalg.eigh(h)
    z = vectors[:, 0]
    left, right = 2 * values[-1] * np.linalg.norm(z), 2 * values[-1] / math.sqrt(values[-1]) * math.sqrt(z @ h @ z)
    differs("(15) the step", left / right, verdict="scan?")
    rng, b = np.random.default_rng(0), np.asarray([1.0, 0.0, 0.0])
    ratios = [abs(b @ h @ z) / math.sqrt(values[-1] * (z @ h @ z)) for z in rng.normal(size=(4000, 3))]
    assert max(ratios) <= 1


def test_the_exponent_of_the_shift():
    a = np.eye(4, k=1)
    differs("e^{2 lambda_max t} = e^{sqrt(q+n) t}", np.linalg.eigvalsh(a + a.T)[-1])
    for t in (0.1, 2.0):
        assert np.linalg.norm(scipy.linalg.expm(a * t), 2) <= math.exp(np.linalg.eigvalsh(a + a.T)[-1] * t / 2) * (1 + 1e-12)


def test_c2_moves_with_mu():
    def c2(mu):
        root = scipy.linalg.inv(scipy.linalg.sqrtm(oracle.h_infinity(2, 0, 1.0)).real)
        c_bar = math.sqrt(2) * np.max(np.sum(np.abs(root), axis=1))
        return 2 * np.linalg.norm(np.eye(2) - oracle.h_infinity(2, 0, mu), 2) * c_bar**4

    differs("C_2 independent of mu", c2(20.0) - c2(2.0))


def test_23_w_does_not_jump_at_its_start():
    """From (23) with t = T: W(T) <= e^{-mu T/4} W(T). The free tracker's W is 1 at T whatever that factor is."""
    found = row("(23) first term")
    assert found.verdict == "false as stated"
    n, q, mu = 2, 1, 20.0
    t = 4 * math.log(found.ours) / mu  # the T behind it
    phi = oracle.transition(n, q, mu, np.eye(3), t)
    h = oracle.h_infinity(n, q, mu)
    z = phi @ np.ones(3)
    assert z @ h @ z > 0
    assert found.ours > 1


def test_the_norm_of_e_may_exceed_that_of_z():
    h = oracle.h_infinity(2, 1, 1.0)
    low = scipy.linalg.eigh(h[1:, 1:] - np.outer(h[1:, 0], h[1:, 0]) / h[0, 0], h[1:, 1:], eigvals_only=True)[0]
    assert low < 1  # the Schur complement lies below: for some e there is a xi that shortens z
    e, xi = np.asarray([1.0, 0.0]), -h[0, 1] / h[0, 0]
    z = np.asarray([xi, *e])
    differs("||e|| <= ||z|| in H_inf", (e @ h[1:, 1:] @ e) / (z @ h @ z))


def test_noise_by_simulation_of_the_filters():
    systems = {q: [oracle.filter_of(3, q, i) for i in (1, 2, 3)] for q in range(4)}
    differs("noise and mu", 10.0)
    ratio = oracle.l1(oracle.filter_of(3, 1, 2, 20.0)) / oracle.l1(oracle.filter_of(3, 1, 2, 2.0))
    assert math.isclose(ratio, 10.0, rel_tol=1e-3)
    differs("noise and q: bounded", oracle.l1(systems[1][0]) / oracle.l1(systems[0][0]), rel_tol=1e-4)
    white = {q: [oracle.h2(s) for s in systems[q]] for q in systems}
    differs("noise and q: white, equal mu", white[3][0] / white[2][0])
    bias = [(math.comb(4, r) / math.comb(3, r)) ** (1 / r) for r in (3, 2, 1)]
    differs("noise and q: white, equal bias", min(white[1][i] / white[0][i] * bias[i] ** (i + 0.5) for i in range(3)))
    edges = []
    for q in (0, 1):
        omega = np.geomspace(1, 10, 20001)
        edges.append(omega[np.searchsorted(-oracle.magnitude(systems[q][0], omega), -1 / math.sqrt(2))])
    differs("noise and q: white, equal bandwidth", white[1][0] / white[0][0] * math.sqrt(edges[0] / edges[1]), rel_tol=1e-3)
    differs("robust against any perturbation", oracle.magnitude(systems[3][0], 0.0)[0], verdict="open")
    raw = 200.0 / oracle.magnitude(oracle.filter_of(3, 1, 2, 20.0), 200.0)[0]
    differs("(43) raw y'", raw)


def test_27_the_integral_starts_from_zero():
    def rate(_, v):
        h = v.reshape(2, 2)
        a = np.eye(2, k=1)
        return (-h - a.T @ h - h @ a + np.diag([1.0, 0.0])).ravel()

    h = scipy.integrate.solve_ivp(rate, (0, 0.01), np.zeros(4), rtol=1e-12, atol=1e-20).y[:, -1].reshape(2, 2)
    differs("(27) epsilon", np.linalg.eigvalsh(h)[0], rel_tol=1e-4)


def test_28_fails_at_the_start():
    phi = oracle.transition(3, 1, 20.0, np.eye(4), 1e-9)
    assert math.isclose(np.linalg.norm(phi, 2), 1, rel_tol=1e-6)  # ||eta(0+)|| = ||eta(0)||
    differs("(28) bound", 1 / 1.1)


@pytest.mark.parametrize(("name", "n", "q"), [("(30) input", 2, 1), ("(33) delay", 3, 0)])
def test_the_printed_systems_lag_behind_a_ramp(name, n, q):
    """y_k = k: the printed recursion, run to rest, ends up `lag` samples late."""
    sigma, size = 0.9, n + q
    a, b, c = loops.structure(n, q)
    f, back = scipy.linalg.expm(a), scipy.linalg.expm(-a)
    h = np.eye(size)
    for _ in range(3000):
        h = sigma * back.T @ h @ back + c.T @ c
    gain = np.linalg.solve(h, c[0])
    eta, lag = np.zeros(size), None
    for k in range(1500):
        eta = f @ eta - gain * (f @ eta)[0] + (b if q else gain) * k
        lag = (k + 1) - eta[q]
    differs(name, lag, rel_tol=1e-5)


def test_31_misses_the_start():
    dt, sigma, k = 0.1, 0.8, 4
    back = np.asarray([[1.0, -dt], [0.0, 1.0]])
    h = np.eye(2)
    for _ in range(k):
        h = sigma * back.T @ h @ back + dt * np.diag([1.0, 0.0])
    total = sum(dt * sigma**j * np.outer([1.0, -dt * j], [1.0, -dt * j]) for j in range(k))
    differs("(31) H_k", np.max(np.abs(h - total)))


def test_33_the_gain_needs_the_matrix_that_counts_the_sample():
    h = loops.discrete_h(3, 0, -math.log(0.9) / 0.01, 0.01, 0.01 / 500, 2)[0]  # the weak start with the sample at hand
    right = 0.01 * np.linalg.solve(h, np.eye(3)[0])[0]
    assert math.isclose(right, 500 / 501, rel_tol=1e-9)
    differs("(33) H_k in the gain", 0.01 / (0.01 / 500))


def test_34_to_37_in_symbols():
    z, s, d, gain, whole = oracle.transfer_35_37()
    printed_gain = [(1 - s) * (s**2 + s + 1), sympy.Rational(3, 2) * (s - 1) ** 2 * (s + 1) / d, (1 - s) ** 3 / d**2]
    assert all(sympy.simplify(a - b) == 0 for a, b in zip(gain, printed_gain, strict=True))
    numerators = [
        (1 - s**3) * z**2 + (3 * s**3 - 3 * s) * z - 3 * s**3 + 3 * s**2,
        (z - 1) / (2 * d) * ((-3 * s + 3 * s**3 + 3 - 3 * s**2) * z - 1 - 5 * s**3 + 9 * s**2 - 3 * s),
        (z - 1) ** 2 / d**2 * (1 - s**3 + 3 * s**2 - 3 * s),
    ]
    for value, numerator in zip(whole, numerators, strict=True):
        assert sympy.simplify(value - numerator / (z - s) ** 3) == 0
    printed = z**3 + (3 * s - 6) * z**2 + (6 - 3 * s**2) * z - 2 + s**3
    assert sympy.simplify(numerators[0].subs(z, 1) / printed.subs(z, 1)) == -1
    largest = max(abs(complex(v)) for v in sympy.Poly(printed.subs(s, sympy.Rational(9, 10)), z).nroots())
    for number in (35, 36, 37):
        assert row(f"({number}) numerator").verdict == "reproduced"
        differs(f"({number}) denominator", largest)


def test_41_and_43_in_symbols():
    y, dy, ddy = oracle.duffing_jet(1, 1, 2)
    found = [
        (-3 * dy + ddy + 4 * y + y**3) * y / (2 * y**3 - dy + 5 * y),
        (3 * dy - 2 * ddy + y + y**3) * y / (2 * y**3 - dy + 5 * y),
    ]
    differs("(41) x1", abs(float(found[0]) - 1))
    differs("(41) x2", float(found[1]))
    p, q = sympy.symbols("p q")
    y, dy, ddy = oracle.duffing_jet(p, q, 2)
    c = ddy + 2 * dy - y
    assert sympy.simplify((9 * y**2 * (y - dy) - 4 * c) / (16 + 18 * y**2 - 3 * y * c) - p) == 0
    assert sympy.expand(p**3 + 2 * p - (y - dy)) == 0
    assert sympy.expand(16 + 18 * y**2 - 3 * y * c - (12 + (3 * y * p + 2) ** 2 + 18 * y**2)) == 0
    flow = scipy.integrate.solve_ivp(
        lambda _, x: [x[1], -x[0] - x[0] ** 3], (0, 20), [1.0, 0.0], rtol=1e-11, atol=1e-12, t_eval=np.arange(0, 20, 0.01)
    )
    x1, x2 = flow.y
    y, dy, ddy = x1 + x2, x2 - x1 - x1**3, -x1 - x1**3 - x2 - 3 * x1**2 * x2
    printed = (-3 * dy + ddy + 4 * y + y**3) * y / (2 * y**3 - ddy + 5 * y)
    differs("(43) formulas", np.median(np.abs(printed - x1)), rel_tol=1e-4)


def test_bounded_derivatives_do_not_bound_the_state():
    y, dy, ddy = sympy.Integer(1), sympy.Integer(0), sympy.Rational(37, 3) + sympy.Rational(1, 10**5)
    c = ddy + 2 * dy - y
    differs("states made of nonpeaking derivatives", abs(float((9 * y**2 * (y - dy) - 4 * c) / (16 + 18 * y**2 - 3 * y * c))))


def test_noise_costs_the_rational_form_more_in_a_plain_loop():
    """Other noise, other code: scipy's trajectory, the loop of tests/oracles, numpy's cubic root."""
    dt, mu, n, q = 0.01, 20.0, 3, 1
    ts = np.arange(0, 20, dt)
    x1, x2 = scipy.integrate.solve_ivp(
        lambda _, x: [x[1], -x[0] - x[0] ** 3], (0, 20), [1.0, 0.0], rtol=1e-10, atol=1e-12, t_eval=ts
    ).y
    noisy = x1 + x2 + 0.1 * np.random.default_rng(5).normal(size=len(ts))
    gains = [dt * np.linalg.inv(h)[:, 0] for h in loops.discrete_h(n, q, mu, dt, 1e-3, 300)]
    gains += [gains[-1]] * (len(ts) - 300)
    y, dy, ddy = loops.run(n, q, dt, gains, noisy, np.zeros(3)).T
    c = ddy + 2 * dy - y
    rational = (9 * y**2 * (y - dy) - 4 * c) / (16 + 18 * y**2 - 3 * y * c)
    cubic = np.asarray([oracle.duffing_root(a, b) for a, b in zip(y, dy, strict=True)])
    rms = [np.sqrt(np.mean((found - x1)[500:] ** 2)) for found in (rational, cubic)]
    assert rms[0] > 2 * rms[1]
    found = row("rational form under noise")
    assert found.verdict == "false as stated"
    assert found.ours > 2


@pytest.mark.slow
def test_everything_else_is_reproduced():
    """The rows that are not, each with its test above."""
    differing = {
        "(8) integral", "(15) the step", "e^{2 lambda_max t} = e^{sqrt(q+n) t}", "C_2 independent of mu", "(23) first term",
        "||e|| <= ||z|| in H_inf", "noise and mu", "noise and q: bounded", "noise and q: white, equal mu",
        "noise and q: white, equal bias", "noise and q: white, equal bandwidth", "robust against any perturbation",
        "(27) epsilon", "(28) bound", "(30) input", "(31) H_k", "(33) delay", "(33) H_k in the gain", "(35) denominator",
        "(36) denominator", "(37) denominator", "(41) x1", "(41) x2", "(43) formulas", "(43) raw y'",
        "states made of nonpeaking derivatives", "rational form under noise",
    }  # fmt: skip
    found = {claim.name: row(claim.name).verdict for claim in papers.load("001").claims}
    assert {name for name, verdict in found.items() if verdict != "reproduced"} == differing
    assert [name for name, verdict in found.items() if verdict == "scan?"] == ["(15) the step"]


def test_known_figures():
    """Values that were found before this was written, by other hands."""
    assert math.isclose(row("static gains peak").ours, 1.3e6, rel_tol=0.05)
    assert math.isclose(row("Theorem 2").ours, 1.05, abs_tol=0.005)
    assert 24 <= row("other H(0)").ours <= 45
    assert math.isclose(row("(41) singularity").ours, 14.68)


@pytest.mark.slow
def test_pictures_have_finite_lines():
    for picture in papers.pictures("001"):
        for panel in picture.panels:
            for line in panel.lines:
                assert len(line.x) == len(line.y) > 5
                assert np.all(np.isfinite(np.asarray(line.y, float)))
