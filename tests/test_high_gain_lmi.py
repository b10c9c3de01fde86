"""designs.high_gain_lmi and its proofs, against closed forms in the plane, Lyapunov equations and exact determinants."""

import dataclasses
import pickle
from fractions import Fraction

import cvxpy as cp
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import chain_lmi as oracle

import jaxobs
from jaxobs import certificates
from jaxobs.certificates import HighGainLmi, NoHighGainLmi, StandardHighGain
from jaxobs.designs import Infeasible, auxiliary, gridding, high_gain_lmi, slopes, smallest_theta, standard_high_gain
from jaxobs.designs.chain_lmi import corners, gain_constant, largest_lambda, triangle_constant
from jaxobs.designs.chain_proofs import certify, refute
from jaxobs.integrators import RK4
from jaxobs.plants import Lorenz, Pendulum, SineChain

BOUNDS = np.array([[-2.0, 1.0], [-0.5, 0.5], [0.0, 1.5]])
GAIN = (4.0, 6.0, 4.0)


def plant(n=3, k_f=1.0):
    return SineChain(jnp.asarray(k_f), n)


# ---- how far (31)-(32) reach


@pytest.mark.parametrize("j0", [0, 1])
@pytest.mark.parametrize(("m1", "m2"), [(1.0, 0.0), (1.0, 0.3), (0.4, 3.0), (20.0, 7.0), (0.1, 0.1)])
def test_smallest_theta_in_the_plane(m1, m2, j0):
    found = smallest_theta([[-m1, m1 / 2], [-m2, m2]], j0)
    exact = oracle.smallest_theta_in_the_plane(m1, m2, j0)
    assert found.theta == pytest.approx(exact, rel=1e-5)
    assert found.refuted <= exact * (1 + 1e-12)
    assert found.refuted == (0.0 if exact == 1 else pytest.approx(exact, rel=1e-5))


@pytest.mark.parametrize("gain", [(3.0, 3.0, 1.0), (4.0, 6.0, 4.0), (2.0, 2.0, 1.0)])
def test_one_matrix_is_a_lyapunov_equation(gain):
    constant = 2.5
    found = smallest_theta(BOUNDS, 0, gain=gain, constant=constant)
    assert found.theta == pytest.approx(oracle.one_corner_theta(gain, np.zeros(3), constant, 0), rel=1e-5)
    row = corners(BOUNDS, 2, 8.0)[-1]
    assert np.linalg.eigvals(np.eye(3, k=1) + np.outer([0, 0, 1], row) - np.outer(gain, [1, 0, 0])).real.max() < 0
    lam = largest_lambda(row[None], np.array(gain))
    assert lam.attained == pytest.approx(2 * 0.5 / oracle.one_corner_theta(gain, row, 0.5, 0, sigma=0.0), rel=1e-6)
    assert lam.attained <= lam.bound * (1 + 1e-9)


@pytest.mark.parametrize("gain", [None, np.array(GAIN)])
def test_lambda_agrees_with_the_problem_written_out(gain):
    rows = corners(BOUNDS, 2, 6.0)
    p, lam, y = cp.Variable((3, 3), symmetric=True), cp.Variable(), cp.Variable((1, 3))
    c = np.eye(1, 3)
    constraints = [p >> 0, np.eye(3) - p >> 0, cp.norm(y) <= 1e4]
    for row in rows:
        a = np.eye(3, k=1)
        a[-1] += row
        sides = p @ a - y.T @ c if gain is None else p @ (a - np.outer(gain, c))
        constraints.append(sides + sides.T + lam * np.eye(3) << 0)
    cp.Problem(cp.Maximize(lam), constraints).solve(solver=cp.CLARABEL)
    found = largest_lambda(rows, gain)
    assert found.attained == pytest.approx(float(lam.value), rel=2e-3 if gain is None else 1e-6)  # |Y| <= 1e4 costs a little
    assert found.attained <= found.bound <= found.attained * (1 + 1e-6)


@pytest.mark.parametrize("j0", [0, 1, 2])
@pytest.mark.parametrize("gain", [None, GAIN])
def test_both_sides_of_the_edge_are_proved(j0, gain):
    found = smallest_theta(BOUNDS, j0, gain=gain)
    assert found.theta * (1 - 1e-4) < found.refuted < found.theta
    below = refute(BOUNDS, j0, found.refuted * (1 - 1e-5), gain=gain)
    assert below.verify()
    assert oracle.refutes(below)
    if gain is not None:
        theta = found.theta * (1 + 1e-5)
        above = certify(BOUNDS, j0, theta, np.array(gain) * theta ** np.arange(1, 4))
        assert above.verify()
        assert oracle.holds_hg_lmi(above)
        assert refute(BOUNDS, j0, theta, gain=gain) is None


def test_no_theta_for_a_gain_without_stability():
    found = smallest_theta(BOUNDS, 1, gain=(1.0, 1.0, 2.0))
    assert found.theta == found.refuted == np.inf
    assert not oracle.is_hurwitz((1.0, 1.0, 2.0))


def test_with_all_slopes_by_corners_every_theta_will_do():
    assert smallest_theta(BOUNDS, 3).theta == 1.0
    for theta in (1.0, 4.0):
        _, proof = high_gain_lmi(plant(), bounds=BOUNDS, j0=3, theta=theta)
        assert oracle.holds_hg_lmi(proof)


def test_constants_bound_the_ratio_and_are_attained():
    rng = np.random.default_rng(0)
    sizes = np.abs(BOUNDS).max(axis=1)
    for j0 in range(4):
        for theta in (1.0, 2.0, 9.0):
            last, k = 3 - j0, gain_constant(BOUNDS, j0, theta)
            psi, e = rng.choice([-1, 1], (500, last)) * sizes[:last], rng.normal(size=(500, 3))
            load = np.abs(np.sum(psi * theta ** np.arange(1, last + 1) * e[:, :last], axis=1)) / theta**3
            assert np.all(load <= k / theta**j0 * np.linalg.norm(e, axis=1))
            direction = sizes[:last] * theta ** np.arange(1.0, last + 1)
            worst = direction @ direction / theta**3 / max(np.linalg.norm(direction), 1e-300)
            assert worst == pytest.approx(k / theta**j0, rel=1e-12)
            assert k <= triangle_constant(BOUNDS, j0) * (1 + 1e-12)


def test_corners_are_those_of_27():
    rows = corners(BOUNDS, 2, 2.0)
    assert rows.tolist() == [[0, -0.125, 0], [0, -0.125, 0.75], [0, 0.125, 0], [0, 0.125, 0.75]]
    assert corners(BOUNDS, 0, 2.0).tolist() == [[0, 0, 0]]
    assert len(corners([[-1, 1], [0, 0], [-1, 1]], 3, 1.0)) == 4  # a pair without width has one value


# ---- the design


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("j0", range(4))
def test_the_certificate_is_about_what_the_observer_carries(j0, dtype):
    observer, proof = high_gain_lmi(jaxobs.astype(plant(), dtype), bounds=BOUNDS, j0=j0)
    assert observer.gain.dtype == dtype
    assert np.array_equal(np.asarray(observer.gain, float)[:, 0], proof.gain)
    assert oracle.holds_hg_lmi(proof)
    assert proof.verify().margins["decay_rate"] > 0
    assert (proof.j0, proof.sigma) == (j0, proof.theta)
    if j0 < 3:
        assert proof.theta == pytest.approx(1.1 * smallest_theta(BOUNDS, j0).theta)


@pytest.mark.parametrize("j0", [0, 2, 3])
def test_a_rate_is_proved(j0):
    _, proof = high_gain_lmi(plant(), bounds=BOUNDS, j0=j0, rate=0.7)
    assert proof.verify().margins["decay_rate"] >= 0.7 * (1 - 1e-6)
    assert oracle.holds_hg_lmi(proof)


def test_the_error_decays_at_the_rate_proved():
    model = plant(3, 6.0)
    observer, proof = high_gain_lmi(model, bounds=[[-2.0, 2.0]] * 3, j0=2, rate=1.0)
    run = jaxobs.simulate(
        model, observer, x0=[1.0, -1.0, 0.5], xhat0=[0.0, 0.0, 0.0], ts=np.arange(0, 8, 0.02), integrator=RK4(substeps=20)
    )
    e = np.asarray(run.xhat - run.x) / proof.theta ** np.arange(1, 4)
    v = np.einsum("ti,ij,tj->t", e, np.array(proof.p), e)
    assert np.all(v <= v[0] * np.exp(-2 * proof.verify().margins["decay_rate"] * np.asarray(run.ts)) * (1 + 1e-6))


def test_the_paper_constant_and_a_given_gain():
    _, proof = high_gain_lmi(plant(), bounds=BOUNDS, j0=1, gain=GAIN, constant=triangle_constant(BOUNDS, 1))
    edge = smallest_theta(BOUNDS, 1, gain=GAIN, constant=triangle_constant(BOUNDS, 1)).theta
    assert proof.theta == pytest.approx(1.1 * edge)
    assert np.allclose(proof.gain, np.array(GAIN) * proof.theta ** np.arange(1, 4))
    assert oracle.holds_hg_lmi(proof)


def test_standard_high_gain_counts_what_f_does_not_depend_on():
    observer, proof = standard_high_gain(Pendulum(), bounds=[[-1.5, -0.5], [0.0, 0.0]])
    assert isinstance(proof, StandardHighGain)
    assert (proof.j0, proof.lower, proof.upper) == (1, (-1.5, 0.0), (-0.5, 0.0))
    assert proof.theta == pytest.approx(1.1 * oracle.smallest_theta_in_the_plane(1.5, 0.0, 1), rel=1e-5)
    assert oracle.holds_standard(proof)
    assert np.array_equal(np.asarray(observer.gain)[:, 0], proof.gain)
    assert standard_high_gain(plant(), bounds=BOUNDS)[1].j0 == 0


def test_gridding_walks_the_whole_grid_and_keeps_the_smallest_gain():
    observer, proof, visits = gridding(plant(), bounds=BOUNDS, j0=1, step=0.1)
    assert [v.tau for v in visits] == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9])
    assert all(v.sigma == pytest.approx(v.tau / (1 - v.tau)) and v.theta >= v.sigma for v in visits)
    assert oracle.holds_hg_lmi(proof)
    assert np.linalg.norm(observer.gain) == pytest.approx(min(v.size for v in visits))
    assert proof.theta >= smallest_theta(BOUNDS, 1).theta


# ---- refusals


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"bounds": [[-1, 1], [1, -1], [0, 0]]}, r"bounds: given lowest 1 > highest -1 for x_2; expected lowest <= highest"),
        ({"bounds": [[-1, 1], [0.5, 1], [0, 0]]}, r"bounds: given \[0\.5, 1\] for x_2; expected a pair that contains 0"),
        ({"bounds": [[-1, -1, 0], [1, 1, 0]]}, r"bounds: given shape \(2, 3\).*transposed"),
        ({"bounds": [[-1, 1]] * 2}, r"bounds: given shape \(2, 2\); expected shape \(3, 2\)"),
        ({"bounds": [[-1, 1], [0, float("inf")], [0, 0]]}, r"bounds: .*expected finite numbers"),
        ({"j0": 4}, r"j0: given 4; expected an integer from 0 to n = 3"),
        ({"j0": -1}, r"j0: given -1"),
        ({"j0": 1.0}, r"j0: given 1\.0"),
        ({"theta": 0.9}, r"theta: given 0\.9; expected a number >= 1"),
        ({"theta": float("nan")}, r"theta: given nan"),
        ({"theta": 9.0, "sigma": 9.5}, r"sigma: given 9\.5; expected a number in \]0, theta = 9\]"),
        ({"sigma": 0.0}, r"sigma: given 0"),
        ({"gain": [[1.0, 2.0, 3.0]]}, r"gain: given shape \(1, 3\).*transposed"),
        ({"gain": [1.0, 2.0]}, r"gain: given shape \(2,\); expected shape \(3,\) or \(3, 1\)"),
        ({"gain": [1.0, 2.0, float("nan")]}, r"gain: .*expected finite numbers"),
        ({"constant": 0.1}, r"constant: given 0\.1; expected at least k_j0"),
        ({"rate": -1.0}, r"rate: given -1"),
    ],
)
def test_bad_input_has_its_own_message(as_users_have_it, wishes, words):
    with pytest.raises(ValueError, match=r"high_gain_lmi\." + words):
        high_gain_lmi(plant(), **({"bounds": BOUNDS, "j0": 1, "theta": 9.0} | wishes))


def test_only_chains_of_two_to_ten_states(as_users_have_it):
    with pytest.raises(ValueError, match=r"plant: given Lorenz; expected a plant in chain form"):
        high_gain_lmi(Lorenz(), bounds=BOUNDS)
    with pytest.raises(ValueError, match=r"bounds: given n = 1 states; expected 2 to 10"):
        high_gain_lmi(plant(1), bounds=[[-1, 1]])
    with pytest.raises(ValueError, match=r"given n = 11 states"):
        high_gain_lmi(plant(11), bounds=[[-1, 1]] * 11)
    with pytest.raises(ValueError, match=r"gridding\.step: given 0\.5"):
        gridding(plant(), bounds=BOUNDS, j0=1, step=0.5)


def test_infeasible_says_which_theta_would_do():
    edge = smallest_theta(BOUNDS, 1)
    with pytest.raises(Infeasible, match=r"\(31\)-\(32\) have no solution for any K with j0 = 1 at theta = 1\.5") as caught:
        high_gain_lmi(plant(), bounds=BOUNDS, j0=1, theta=1.5)
    assert caught.value.best == pytest.approx(edge.theta, rel=1e-6)
    assert caught.value.margin < 0
    assert "unstable" not in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    with pytest.raises(Infeasible, match=r"Another K may need less"):
        high_gain_lmi(plant(), bounds=BOUNDS, j0=1, gain=GAIN, theta=1.5)
    with pytest.raises(Infeasible, match=r"A - K C is not Hurwitz"):
        high_gain_lmi(plant(), bounds=BOUNDS, j0=1, gain=(1.0, 1.0, 2.0))


# ---- certificates


def proofs():
    _, hg_lmi = high_gain_lmi(plant(), bounds=BOUNDS, j0=2, theta=4.0, sigma=3.5)
    _, standard = standard_high_gain(Pendulum(), bounds=[[-1.5, 1.5], [0.0, 0.0]])
    return hg_lmi, standard, refute(BOUNDS, 1, 1.5), refute(BOUNDS, 1, 1.5, gain=GAIN)


def test_proofs_survive_a_file(tmp_path):
    for proof in proofs():
        proof.to_json(tmp_path / "c.json")
        assert certificates.load(tmp_path / "c.json") == proof
        assert proof.verify()
        assert len(proof.assumptions) >= 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"theta": 0.5, "sigma": 0.5}, "theta = 0.5 is less than 1"),
        ({"sigma": 4.5}, "sigma is outside"),
        ({"sigma": 0.0}, "sigma is outside"),
        ({"sigma": 0.3}, "fails at the corner"),
        ({"j0": 4}, "j0 = 4 is outside 0..3"),
        ({"lower": (0.1, -0.5, 0.0)}, "excludes 0"),
        ({"lower": (2.0, -0.5, 0.0)}, "a lower bound exceeds"),
        ({"upper": (1.0, 0.5, 9.0)}, "fails at the corner"),
        ({"lower": (-9.0, -0.5, 0.0)}, "too small for the slopes"),
        ({"constant": 0.1}, "too small for the slopes"),
        ({"constant": 40.0}, "(32)"),
        ({"constant": -1.0}, "not negative"),
        ({"nu": 0.5}, "0 < P < nu I fails"),
        ({"nu": 50.0}, "(32)"),
        ({"lam": 0.5}, "fails at the corner"),
        ({"lam": -1.0}, "must be positive"),
        ({"gain": (1.0, 1.0, 1.0)}, "fails at the corner"),
        ({"gain": (1.0, 1.0)}, "not all of size 3"),
        ({"gain": (1.0, 1.0, float("nan"))}, "not finite"),
        ({"p": ((1.0, 0.0), (0.0, 1.0))}, "not all of size 3"),
        ({"p": ((1.0, 0.1, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "0 < P < nu I fails"),
        ({"lower": (-1.0,) * 11}, "11 states"),
    ],
)
def test_false_claims_are_refused_with_their_reason(changes, reason):
    false = dataclasses.replace(proofs()[0], **changes)
    verdict = false.verify()
    assert not verdict
    assert reason in verdict.why


def test_a_standard_certificate_needs_17():
    standard = proofs()[1]
    assert "(17) fails" in dataclasses.replace(standard, upper=(1.5, 1e-300)).verify().why
    slower = dataclasses.replace(standard, theta=1.0, gain=tuple(x / standard.theta**i for i, x in enumerate(standard.gain, 1)))
    assert "theta^{1+j0} > 2 k nu / lam fails" in slower.verify().why
    assert "too small for the slopes, (18)" in dataclasses.replace(standard, constant=1.4).verify().why


def mutated(proof, rng):
    """One stored number changed by anything from the last digit to a factor or its sign."""
    name = rng.choice([f.name for f in dataclasses.fields(proof) if f.name != "j0" and getattr(proof, f.name) != ()])
    value = np.array(getattr(proof, name), float)
    place = tuple(rng.integers(0, s) for s in value.shape)
    factor = rng.choice([1 + 2.0**-52, 1 - 1e-9, 1 + 1e-6, 0.99, 1.05, 2.0, -1.0, 0.0])
    value[place] *= factor
    if name in ("p", "w") and rng.random() < 0.7:
        value[place[::-1]] = value[place]
    changed = value.tolist()
    as_tuple = tuple(tuple(row) if isinstance(row, list) else row for row in changed) if value.ndim else float(value)
    return dataclasses.replace(proof, **{name: as_tuple})


def judge(proof):
    match proof:
        case HighGainLmi():
            return oracle.holds_hg_lmi(proof)
        case StandardHighGain():
            return oracle.holds_standard(proof)
        case NoHighGainLmi():
            return oracle.refutes(proof)


def test_mutations_are_judged_as_the_oracle_does():
    rng, counts = np.random.default_rng(0), {True: 0, False: 0}
    for proof in proofs():
        for _ in range(60):
            changed = mutated(proof, rng)
            if any(lo > hi for lo, hi in zip(changed.lower, changed.upper, strict=True)):
                continue
            assert changed.verify().holds == judge(changed), changed
            counts[judge(changed)] += 1
    assert min(counts.values()) > 30, counts


def test_what_is_possible_is_not_refuted():
    theta = smallest_theta(BOUNDS, 1).theta
    assert refute(BOUNDS, 1, 1.01 * theta) is None
    wrong = dataclasses.replace(refute(BOUNDS, 1, 1.5), theta=float(1.01 * theta))
    assert not wrong.verify()
    some = refute(BOUNDS, 1, 1.5, gain=GAIN)
    assert "does not cancel the gain" in dataclasses.replace(some, gain=()).verify().why


# ---- slopes


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
