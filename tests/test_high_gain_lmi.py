"""designs.high_gain_lmi, standard_high_gain and gridding: what is proved of their observers, and refusals."""

import pickle

import jax.numpy as jnp
import numpy as np
import pytest
from chain_cases import BOUNDS, GAIN, plant
from oracles import chain_lmi as oracle

import jaxobs
from jaxobs.certificates import HighGainLmi
from jaxobs.designs import Infeasible, gridding, high_gain_lmi, smallest_theta, standard_high_gain
from jaxobs.designs.chain_lmi import triangle_constant
from jaxobs.integrators import RK4
from jaxobs.plants import Lorenz, Pendulum


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
    assert isinstance(proof, HighGainLmi)
    assert (proof.j0, proof.lower, proof.upper) == (1, (-1.5, 0.0), (-0.5, 0.0))
    assert proof.theta == pytest.approx(1.1 * oracle.smallest_theta_in_the_plane(1.5, 0.0, 1), rel=1e-5)
    assert oracle.holds_hg_lmi(proof)
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
