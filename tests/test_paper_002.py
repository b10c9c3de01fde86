"""Paper 002: wherever our number is not the printed one, another route arrives at ours."""

import numpy as np
import pytest
import scipy.integrate
from oracles import chain_lmi as oracle

from jaxobs.certificates import HighGainLmi, NoHighGainLmi
from jaxobs.designs import high_gain_lmi
from jaxobs.designs.chain_proofs import certify, refute
from jaxobs.papers import load
from jaxobs.papers.claims import half_digit
from jaxobs.papers.p002 import figure, method, shared
from jaxobs.papers.p002.paper import TABLE, N

# Rows (j0, k_f) of table I: the printed theta is out of reach of any K; the printed L has no common P on the full box.
IMPOSSIBLE_PRINTED_K = {(1, 100), (2, 10), (2, 100), (3, 10), (3, 100)}
IMPOSSIBLE_SHARP_K = {(2, 100), (3, 10), (3, 100)}
NO_COMMON_P = {(2, 100), (3, 10), (3, 100)}

HG_LMI = [pytest.param(one, id=f"{one.j0},{one.k_f}") for one in TABLE if one.j0]
ALL = [pytest.param(one, id=f"{one.j0},{one.k_f}") for one in TABLE]


def claim(name):
    return next(one for one in load("002").claims if one.name == name).check()


@pytest.mark.parametrize("one", ALL)
def test_one_corner_alone_reproduces_the_printed_theta(one):
    """(31) at all slopes +k_f/5 is one Lyapunov equation."""
    sigma = float(one.sigma or 1)
    row = [0.0] * (N - one.j0) + [one.k_f / 5 / sigma**power for power in range(one.j0, 0, -1)]
    theta = oracle.one_corner_theta(one.gain, row, one.k_f * (5 - one.j0) / 5, one.j0, sigma)
    assert shared.one_corner(one) == pytest.approx(theta, rel=1e-6)
    assert theta == pytest.approx(float(one.theta), rel=1.1e-3)  # K is printed with two decimals
    assert theta <= sum(half_digit(one.theta))


def test_the_standard_gain_at_the_sharp_constant():
    """k_f sqrt(5)/5 in place of k_f, and at theta less: 31.72 becomes 6.42, by the Lyapunov equation alone."""
    one = shared.row(0, 1)
    plain = oracle.one_corner_theta(one.gain, np.zeros(N), 1.0, 0)
    assert plain == pytest.approx(31.717, abs=1e-3)

    def excess(theta):
        k = np.sqrt(sum(theta ** (-2.0 * i) for i in range(N))) / 5
        return theta - k * plain

    low, high = 1.0, 31.72
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if excess(middle) > 0 else (middle, high)
    assert shared.needed(one, sharp=True).theta == pytest.approx(high, rel=1e-5)
    assert high == pytest.approx(6.42, abs=5e-3)


@pytest.mark.parametrize("one", ALL)
def test_nominal_poles_by_routh(one):
    assert (shared.nominal(one) < 0) == oracle.is_hurwitz(one.gain)
    assert oracle.is_hurwitz(one.gain) == ((one.j0, one.k_f) != (3, 100))


def test_the_unstable_row():
    assert shared.nominal(shared.row(3, 100)) == pytest.approx(0.281, abs=5e-4)
    roots = np.roots([1, *shared.row(3, 100).gain])
    assert shared.nominal(shared.row(3, 100)) == pytest.approx(roots.real.max(), rel=1e-9)
    assert claim("Table I (3, 100) nominal poles").verdict == "false as stated"


@pytest.mark.parametrize("one", HG_LMI)
def test_every_printed_theta_is_too_small_for_its_gain(one):
    proof = shared.refuted(one, True)
    assert proof.verify()
    assert oracle.refutes(proof)
    assert proof.gain == one.gain
    assert proof.theta >= float(one.theta)
    assert proof.constant == pytest.approx(one.k_f * (5 - one.j0) / 5)
    assert len(proof.multipliers) == 5 * 2**one.j0


@pytest.mark.parametrize(("sharp", "rows"), [(False, IMPOSSIBLE_PRINTED_K), (True, IMPOSSIBLE_SHARP_K)])
def test_which_thetas_are_impossible_for_any_gain(sharp, rows):
    found = {(one.j0, one.k_f): shared.refuted(one, False, sharp) for one in TABLE}
    assert {key for key, proof in found.items() if proof is not None} == rows
    for key in rows:
        assert found[key].gain == ()
        assert oracle.refutes(found[key])


@pytest.mark.slow
@pytest.mark.parametrize("sharp", [False, True])
@pytest.mark.parametrize("one", ALL)
def test_possible_rows_have_a_design_at_the_printed_theta(one, sharp):
    impossible = IMPOSSIBLE_SHARP_K if sharp else IMPOSSIBLE_PRINTED_K
    smallest = shared.smallest(one, sharp=sharp)
    assert (smallest.theta > float(one.theta)) == ((one.j0, one.k_f) in impossible)
    assert smallest.refuted == pytest.approx(smallest.theta, rel=1e-4)
    if (one.j0, one.k_f) not in impossible:
        constant = None if sharp else shared.printed_constant(one)
        theta = float(one.theta)
        _, proof = high_gain_lmi(
            shared.plant(one.k_f), bounds=shared.bounds(one.k_f), j0=one.j0, theta=theta, constant=constant
        )
        assert oracle.holds_hg_lmi(proof)


@pytest.mark.slow
@pytest.mark.parametrize("one", HG_LMI)
def test_theta_that_the_printed_gain_needs_is_proved_on_both_sides(one):
    for sharp in (False, True):
        found = shared.needed(one, sharp=sharp)
        constant = None if sharp else shared.printed_constant(one)
        if (one.j0, one.k_f) == (3, 100):
            assert found.theta == np.inf
            continue
        theta = found.theta * (1 + 1e-5)
        above = certify(
            shared.bounds(one.k_f), one.j0, theta, np.array(one.gain) * theta ** np.arange(1, N + 1), constant=constant
        )
        below = refute(shared.bounds(one.k_f), one.j0, found.theta * (1 - 1e-3), gain=one.gain, constant=constant)
        assert oracle.holds_hg_lmi(above)
        assert oracle.refutes(below)


@pytest.mark.parametrize("one", ALL)
def test_full_box_of_the_printed_gain(one):
    proof = shared.full_box(one)
    if (one.j0, one.k_f) in NO_COMMON_P:
        assert isinstance(proof, NoHighGainLmi)
        assert proof.constant == 0
        assert not np.any(proof.w)
        assert oracle.refutes(proof)
    else:
        assert isinstance(proof, HighGainLmi)
        assert proof.j0 == N
        assert oracle.holds_hg_lmi(proof)
        assert np.allclose(proof.gain, np.array(one.gain) * float(one.theta) ** np.arange(1, N + 1), rtol=1e-14)


def test_frozen_corners_of_the_rows_without_common_p():
    worst = {key: shared.frozen(shared.row(*key)) for key in NO_COMMON_P}
    assert worst[2, 100] < 0
    assert worst[3, 10] < 0
    assert worst[3, 100] > 0


@pytest.mark.slow
@pytest.mark.parametrize("k_f", [1, 10, 100])
def test_lpv_lmi_has_a_solution_at_sigma_one(k_f):
    proof = shared.at_one(k_f)
    assert (proof.sigma, proof.theta, proof.j0) == (1.0, 1.0, N)
    assert proof.upper == (k_f / 5,) * N
    assert oracle.holds_hg_lmi(proof)
    floor = k_f / 5 * (1 + k_f / 5) ** np.arange(N)  # of any gain that is stable at the frozen corners
    assert np.all(np.array(proof.gain) > floor)


@pytest.mark.parametrize(("j0", "printed"), [(1, 0.8), (2, 0.6), (3, 0.4)])
def test_the_printed_constants_are_loose(j0, printed):
    """The worst unit vector of sum_i psi_i e_i, i <= 5 - j0, all |psi_i| = 1/5, is (1, ..., 1)/sqrt(5 - j0)."""
    rng = np.random.default_rng(0)
    e = rng.normal(size=(2000, N - j0))
    ratios = np.abs(e).sum(axis=1) / 5 / np.linalg.norm(e, axis=1)
    row = claim(f"k_{j0} at k_f = 1")
    assert ratios.max() <= row.ours * (1 + 1e-12)
    assert row.ours == pytest.approx(np.sqrt(N - j0) / 5, rel=1e-12)
    assert row.ours < printed
    assert row.verdict == "conservative"


def test_bounds_7_and_14():
    x, d = np.random.default_rng(1).normal(size=(2, 4000, N)) * 3
    change = np.abs(np.sum(np.sin(x + d) - np.sin(x), axis=1)) / 5
    assert np.all(change <= claim("(7) gamma_f").ours * np.abs(d).sum(axis=1))
    assert np.all(change <= claim("(14) k_f").ours * np.linalg.norm(d, axis=1))


def test_the_converse_of_lemma_2_fails_with_the_same_constant():
    """Psi(X) = (sum x) (1, ..., 1)': slopes 1, and the spectral norm of the matrix of ones is n."""
    row = claim("lemma 2, converse")
    assert row.verdict == "false as stated"
    assert row.ours == pytest.approx(np.linalg.norm(np.ones((N, N)), 2))


def test_what_lpv_lmi_corresponds_to():
    """k_j0 = 0, and with it (32) vanishes, when no slope is left: n - j0 = 0."""
    assert claim("LPV/LMI corresponds to j0").ours == N
    assert claim("lemma 2, components of Psi").ours == N


def test_sigma_one_can_be_the_best():
    """k_f = 0.01, j0 = 1: a certificate at theta = sigma = 1, below which theta may not go."""
    _, proof = high_gain_lmi(shared.plant(0.01), bounds=shared.bounds(0.01), j0=1, theta=1.0)
    assert oracle.holds_hg_lmi(proof)
    assert claim("better solutions for sigma > 1").verdict == "false as stated"


@pytest.mark.slow
def test_step_iv_must_move_on():
    _, proof, visits = method._walk()
    assert oracle.holds_hg_lmi(proof)
    sizes = [v.size for v in visits]
    assert sizes[0] == max(s for s in sizes[:10])
    assert np.argmin(sizes) > 0
    found = claim("algorithm (iv)")
    assert (found.verdict, found.ours) == ("slip", 3)
    assert f"{min(sizes):.5g}" in found.why


@pytest.mark.slow
def test_figure_1_by_runge_kutta():
    """The printed gain of j0 = 3 by SciPy, with the same held noise."""
    path, j0 = figure.runs(), 3
    ts, gain = np.asarray(path.ts)[j0], shared.gain(shared.row(j0, 1))
    w = np.asarray(path.y)[j0, :, 0] - np.asarray(path.x)[j0, :, 0]

    def flow(t, z, noise):
        x, xhat = z[:N], z[N:]
        dx, dxhat = (np.append(v[1:], np.sum(np.sin(v)) / 5) for v in (x, xhat))
        return np.concatenate([dx, dxhat + gain * (x[0] + noise - xhat[0])])

    z, stop = np.concatenate([np.ones(N), 5 * np.ones(N)]), 500
    for k in range(stop):
        z = scipy.integrate.solve_ivp(flow, (ts[k], ts[k + 1]), z, args=(w[k],), rtol=1e-9, atol=1e-9).y[:, -1]
    assert np.allclose(z[N:], np.asarray(path.xhat)[j0, stop], rtol=1e-5, atol=1e-5)
    assert 0.08 < w.std() < 0.12


def test_the_step_of_runge_kutta_at_k_f_100():
    poles = np.roots([1, *shared.gain(shared.row(0, 100))])
    assert claim("standard observer, explicit step at k_f = 100").ours == pytest.approx(
        2.785293563405282 / np.abs(poles).max(), rel=1e-6
    )
