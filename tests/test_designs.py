"""designs.riccati: a certificate for the numbers that the observer carries, or Infeasible with what to change."""

import dataclasses
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import certificate, riccati

import jaxobs
from jaxobs import hurwitz
from jaxobs._module import Scalar, param, static
from jaxobs.certificates import Condition5
from jaxobs.designs import Infeasible
from jaxobs.observers import HighGain, IntegralHighGain
from jaxobs.plants import AbstractChain, Lorenz, Pendulum


class Softened(AbstractChain):
    """x_n' = rate tanh(x_1): a chain of any length whose leaf has a precision."""

    n: int = static()
    rate: Scalar = param(default=1.5)
    m = 0

    def phi(self, x, u):
        return self.rate * jnp.tanh(x[0])


def judged(c):
    return certificate.holds(c.alphas, c.gamma, c.lipschitz, c.mu, c.nu)


@pytest.mark.filterwarnings("ignore::jaxobs.designs.LargeGain")
@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
@pytest.mark.parametrize("n", range(1, 9))
@pytest.mark.parametrize("q", [0, 1, 2])
def test_the_certificate_is_about_what_the_observer_carries(n, q, dtype):
    plant = jaxobs.astype(Softened(n), dtype)
    observer, c = jaxobs.designs.riccati(plant, lipschitz=1.5, q=q)
    assert isinstance(observer, IntegralHighGain if q else HighGain)
    assert observer.alphas.dtype == observer.gamma.dtype == dtype
    assert c.verify()
    assert judged(c)
    assert (c.n, c.q, c.lipschitz) == (n, q, 1.5)
    assert np.array_equal(np.asarray(observer.alphas, float), c.alphas)
    assert float(observer.gamma) == c.gamma
    assert len(c.assumptions) >= 3
    assert (observer.n, observer.m) == (plant.n, plant.m)


@pytest.mark.filterwarnings("ignore::jaxobs.designs.LargeGain")
@pytest.mark.parametrize("q", [0, 2])
def test_random_alphas_in_single_precision(q):
    plant = jaxobs.astype(Pendulum(), jnp.float32)
    log_q = jnp.asarray(np.random.default_rng(q).uniform(-2, 2, 2 + q))
    observer, c = jaxobs.designs.riccati(
        plant, lipschitz=1.1180339887498949, alphas=jax.jit(hurwitz.alphas_from_log_q)(log_q), q=q
    )
    assert observer.alphas.dtype == jnp.float32
    assert np.array_equal(np.asarray(observer.alphas, float), c.alphas)
    assert judged(c)


def test_default_gamma_is_ten_percent_above_the_smallest():
    observer, c = jaxobs.designs.riccati(Pendulum(), lipschitz=1.5, alphas=[3.0, 2.0])
    assert float(observer.gamma) == pytest.approx(1.1 * riccati.smallest_gamma([3.0, 2.0], 1.5), rel=1e-9)
    assert c.verify().margins["decay_rate_of_V"] > 0


def test_the_edge_of_gamma_is_certified_from_just_above_it():
    edge = riccati.smallest_gamma([3.0, 2.0], 1.5)
    _, c = jaxobs.designs.riccati(Pendulum(), lipschitz=1.5, alphas=[3.0, 2.0], gamma=edge * (1 + 1e-9))
    assert judged(c)
    with pytest.raises(Infeasible):
        jaxobs.designs.riccati(Pendulum(), lipschitz=1.5, alphas=[3.0, 2.0], gamma=edge * (1 - 1e-9))


def test_certificate_of_the_paper():
    _, c = jaxobs.designs.riccati(Pendulum(), lipschitz=1.5, alphas=[3.0, 2.0], gamma=6.0)
    assert isinstance(c, Condition5)
    assert c.mu == pytest.approx(3.5620, abs=5e-5)
    assert c.verify().margins["largest_lipschitz"] == pytest.approx(1.5683, abs=5e-5)
    assert not dataclasses.replace(c, lipschitz=1.5683).verify()


@pytest.mark.parametrize(
    ("wishes", "margin", "words"),
    [
        ({"alphas": [3.0, 2.0], "gamma": 5.0}, None, ["condition (5) fails at gamma = 5", "gamma > 5.73966"]),
        ({"gamma": 6.0, "q": 2}, None, ["condition (44) fails at gamma = 6", "gamma > 39.6251"]),
        ({"alphas": [1.0, 2.0], "gamma": 6.0}, -3.0, ["(10)", "q_1 = -3", "alphas_from_log_q"]),
        ({"alphas": [3.0, 5.0, 2.0, 1.0], "gamma": 6.0, "q": 2}, -1.0, ["q_1 = -1"]),
        ({"alphas": [2.0, 1.0, 0.6], "q": 1}, None, ["q_2 = -1.4"]),
    ],
)
def test_infeasible_says_by_how_much_and_what_to_change(wishes, margin, words):
    with pytest.raises(Infeasible) as caught:
        jaxobs.designs.riccati(Pendulum(), lipschitz=1.5, **wishes)
    text = str(caught.value)
    assert all(word in text for word in words), text
    assert "unstable" not in text
    assert caught.value.margin < 0
    assert caught.value.change in text
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.smallest_gamma) == (text, caught.value.smallest_gamma)
    if "(10)" not in text:
        alphas = wishes.get("alphas", [4.0, 6.0, 4.0, 1.0])
        assert caught.value.margin == pytest.approx(riccati.largest_lipschitz(alphas, wishes["gamma"]) - 1.5, rel=1e-9)
    elif margin is not None:
        assert caught.value.margin == margin


@pytest.mark.parametrize("lipschitz", [0.0, -1.0, float("nan"), float("inf")])
def test_a_lipschitz_constant_is_positive(lipschitz):
    with pytest.raises(ValueError, match=r"riccati\.lipschitz"):
        jaxobs.designs.riccati(Pendulum(), lipschitz=lipschitz)


@pytest.mark.parametrize("plant", [Lorenz(), None, "pendulum"])
def test_only_chains(as_users_have_it, plant):
    with pytest.raises(ValueError, match="chain form"):
        jaxobs.designs.riccati(plant, lipschitz=1.0)


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"alphas": [3.0, 2.0, 1.0]}, r"HighGain\.alphas: given shape \(3,\); expected shape \(2,\)"),
        ({"alphas": [3.0, 2.0], "q": 1}, r"IntegralHighGain\.alphas: given shape \(2,\)"),
        ({"alphas": [3.0, -2.0]}, "left half plane"),
        ({"alphas": [float("nan"), 2.0]}, "finite"),
        ({"gamma": 0.0}, r"HighGain\.gamma"),
        ({"gamma": -6.0}, r"HighGain\.gamma"),
        ({"gamma": float("nan")}, r"HighGain\.gamma"),
        ({"q": -1, "alphas": [1.0]}, r"riccati\.q"),
        ({"q": 1.0, "alphas": [3.0, 3.0, 1.0]}, r"riccati\.q"),
    ],
)
def test_what_the_observer_refuses_the_design_refuses(as_users_have_it, wishes, words):
    with pytest.raises(ValueError, match=words):
        jaxobs.designs.riccati(Pendulum(), lipschitz=1.5, **wishes)


def test_beyond_the_limits_of_floats_nothing_is_certified():
    """lambda_max(P) ~ gamma^3 overflows: condition (5) is true, and says so, but there is no witness to store."""
    with pytest.raises(Infeasible, match=r"holds in float64, but no float witnesses") as caught:
        jaxobs.designs.riccati(Pendulum(), lipschitz=1.5, alphas=[3.0, 2.0], gamma=1e120)
    assert caught.value.margin > 0
