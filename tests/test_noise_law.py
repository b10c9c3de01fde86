"""The quietest alphas at equal speed: measures against closed forms and quadrature, optima against theory and random search."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from oracles import noise, polynomial, speed

from jaxobs import hurwitz
from jaxobs.tuning import MEASURES, noise_constant, noise_law, quietest, settling_time, squared_error

REFERENCE = (3.0, 2.0)
REFERENCE_COST = 2 / 3 * (11 / 12) ** 3  # c times the cube of the squared error
CASES = [((3.0, 2.0), 0), ((2.0, 1.0), 0), ((1.0, 2.0), 0), ((3.0, 3.0, 1.0), 1), ((5.0, 10.0, 10.0, 5.0, 1.0), 3)]


def test_settling_time_of_two_real_poles():
    """(3, 2): e_x2 = 2 e^-t - e^-2t falls from 1, and is 0.05 where 2 x - x^2 = 0.05, x = e^-t."""
    x = min(np.roots([1, -2, 0.05]))
    assert float(settling_time(REFERENCE)) == pytest.approx(-np.log(x), rel=2e-4)


def test_settling_time_from_an_error_of_the_output():
    """From e_x1(0) = 1: e_x2 = 2 (e^-2t - e^-t), which leaves 5 % of its peak 1/2 for good where x - x^2 = 1/80, x = e^-t."""
    x = min(np.roots([1, -1, 1 / 80]))
    assert float(settling_time(REFERENCE, start=1)) == pytest.approx(-np.log(x), rel=2e-4)


@pytest.mark.parametrize(("alphas", "q"), CASES)
def test_measures_equal_a_dense_response(alphas, q):
    assert float(settling_time(alphas, q)) == pytest.approx(speed.settling(alphas, q), abs=4e-3)
    assert float(squared_error(alphas, q)) == pytest.approx(speed.squared(alphas, q), rel=1e-6)
    assert float(noise_constant(alphas, q)) == pytest.approx(noise.white(alphas, q)[q + 1, q + 1], rel=1e-9)


@pytest.mark.parametrize("measure", MEASURES)
def test_speed_is_proportional_to_gamma(measure):
    alphas = jnp.asarray([3.0, 3.5, 1.2])
    scaled = alphas * 7.0 ** jnp.arange(1.0, 4.0)
    assert float(noise_law.speed(measure, scaled, 1)) == pytest.approx(7 * float(noise_law.speed(measure, alphas, 1)), rel=1e-6)


def test_equal_squared_error_without_integrators():
    """Damping 1 / sqrt(2) attains c * (squared error)^3 = 27/64, the Kalman filter's bound for every linear observer."""
    for weight in (0.1, 1.0, 7.0):
        assert speed.least_cost(weight) == pytest.approx(np.sqrt(2) * weight**0.75, rel=1e-9)
    # c + weight I >= sqrt(2) weight^(3/4) for all weights: the best weight gives c I^3 >= 27/64.
    best = scipy.optimize.minimize_scalar(lambda w: w - np.sqrt(2) * w**0.75, bounds=(0.1, 10), method="bounded")
    assert -best.fun == pytest.approx(27 / 64, rel=1e-9)
    found = quietest("squared error", 0)
    assert found.ratio == pytest.approx(np.sqrt(27 / 64 / REFERENCE_COST), rel=1e-6)
    assert found.alphas[0] ** 2 / found.alphas[1] == pytest.approx(2, rel=1e-3)
    assert speed.squared(found.alphas, 0) == pytest.approx(11 / 12, rel=1e-6)


def test_equal_squared_error_with_integrators_is_no_better():
    found = quietest("squared error", 1)
    bound = np.sqrt(27 / 64 / REFERENCE_COST)
    assert bound < found.ratio < bound * (1 + 1e-4)
    limited = quietest("squared error", 1, spread=2.0)
    assert limited.ratio > 1.01 * bound
    assert abs(np.roots([1, *limited.alphas])).max() < 0.1 * abs(np.roots([1, *found.alphas])).max()


@pytest.mark.parametrize("q", [0, 1])
def test_at_equal_abscissa_the_poles_meet(q):
    found = quietest("spectral abscissa", q)
    assert found.alphas == pytest.approx(np.asarray(hurwitz.binomial(2 + q)), rel=1e-4)
    assert found.ratio == pytest.approx(np.sqrt(noise.white(found.alphas, q)[q + 1, q + 1] * 1.5), rel=1e-6)


def test_equal_settling_time_without_integrators():
    """(10) stops at the damping 1 / sqrt(2), and there the optimum lies: less damping would be quieter still."""
    found = quietest("settling time", 0)
    assert found.alphas[0] ** 2 / found.alphas[1] == pytest.approx(2, rel=2e-3)
    dense = speed.settling(found.alphas, 0)
    assert dense == pytest.approx(speed.settling(REFERENCE, 0), abs=4e-3)
    by_hand = [np.sqrt(2.0), 1.0]
    stretch = speed.settling(by_hand, 0) / speed.settling(REFERENCE, 0)
    assert found.ratio == pytest.approx(np.sqrt(noise.white(by_hand, 0)[1, 1] * stretch**3 * 1.5), rel=2e-3)


def test_equal_settling_time_with_one_integrator():
    """As fast as (3, 2) by a dense response, and no random polynomial with (10) is quieter."""
    found = quietest("settling time", 1)
    target = speed.settling(REFERENCE, 0)
    assert speed.settling(found.alphas, 1) == pytest.approx(target, abs=5e-3)
    assert found.ratio < quietest("settling time", 0).ratio
    rng, best = np.random.default_rng(0), np.inf
    for _ in range(150):
        alphas = polynomial.spectral_factor(np.exp(rng.uniform([-4, -4, -1], [1, 1, 1])))
        for count in (2_001, 40_001):  # coarse, then fine if it came near
            stretch = speed.settling(alphas, 1, count=count) / target
            ratio = np.sqrt(noise.white(alphas, 1)[2, 2] * stretch**3 * 1.5)
            if ratio > 1.02 * min(best, found.ratio):
                break
        else:
            best = min(best, ratio)
    assert found.ratio < best * (1 + 1e-3)
    assert best < 1.25 * found.ratio, "the random search came near"


def test_a_search_repeats_itself():
    first = quietest("squared error", 0)
    noise_law._quietest.cache_clear()
    assert np.array_equal(first.alphas, quietest("squared error", 0).alphas)


def test_what_cannot_be_searched_is_refused(as_users_have_it):
    with pytest.raises(ValueError, match="q: given -1; expected an integer >= 0"):
        quietest("squared error", -1)
    with pytest.raises(ValueError, match="measure: given 'overshoot'; expected one of settling time"):
        quietest("overshoot", 0)
    with pytest.raises(ValueError, match="measure: given 'overshoot'"):
        noise_law.speed("overshoot", REFERENCE)
    with pytest.raises(ValueError, match="reference"):
        quietest("squared error", 0, reference=(1.0, -2.0))
    with pytest.raises(ValueError, match="spread"):
        quietest("squared error", 0, spread=0.0)
    with jax.enable_x64(False), pytest.raises(ValueError, match="expected float64"):
        quietest("squared error", 0)
