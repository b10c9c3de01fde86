"""designs.lpv_model: structure of bounds, exact midpoints, slopes of a run."""

import numpy as np
import pytest
from lpv_cases import HIGH, LORENZ, LOW, T, joint_channels, lorenz_entries
from oracles import lpv

from jaxobs import designs, plants
from jaxobs.designs import lpv_lmi, lpv_model, midpoint_channels, slope_entries
from jaxobs.integrators import Euler
from jaxobs.plants import Discretised

RNG = np.random.default_rng(7)


@pytest.mark.parametrize(
    ("model", "corners"),
    [
        (lambda: lpv_model(plants.ForcedDuffing(), slope_entries([[0, 0]], [[45.86, 0]])), 2),
        (lambda: lpv_model(plants.FlexibleJoint(), joint_channels(1.0)), 4),
        (lambda: lpv_model(LORENZ, midpoint_channels(LORENZ, LOW, HIGH)), 8),
        (lambda: lpv_model(LORENZ, slope_entries(*lorenz_entries())), 16),
        (lambda: lpv_model(LORENZ, slope_entries(*lorenz_entries()), inner=True), 8),  # y = x2: its column goes
        (lambda: lpv_model(LORENZ, midpoint_channels(LORENZ, LOW, HIGH), inner=True), 8),
    ],
)
def test_zeros_ties_and_measured_states_make_no_corners(model, corners):
    assert len(model().corners()) == corners


@pytest.mark.parametrize("plant", [LORENZ, plants.Rossler(), Discretised(LORENZ, Euler(), T)])
def test_the_midpoint_is_exact(plant):
    """A(m) (x - z) is the difference of the right-hand sides, at m = (x + z) / 2."""
    flow = plant.plant if isinstance(plant, Discretised) else plant
    channels = midpoint_channels(flow, np.full(3, -99.0), np.full(3, 99.0))
    model = lpv_model(plant, channels)
    rhs = lpv.rossler if isinstance(flow, plants.Rossler) else lpv.lorenz
    for x, z in RNG.normal(size=(8, 2, 3)) * 9:
        rho = np.where(channels.lower == channels.upper, channels.lower, ((x + z) / 2)[list(channels.tied)])
        expected = rhs(x) - rhs(z)
        if isinstance(plant, Discretised):
            expected = x - z + T * expected
        np.testing.assert_allclose(model.at(rho) @ (x - z), expected, rtol=1e-9, atol=1e-9)


def test_slopes_of_a_run_are_its_extremes():
    xs = RNG.normal(size=(500, 3)) * 5
    channels = designs.simulated_entries(LORENZ, xs)
    np.testing.assert_allclose(channels.lower, xs.min(0)[[2, 0, 1, 0]])
    np.testing.assert_allclose(channels.upper, xs.max(0)[[2, 0, 1, 0]])
    assert "conditional" in channels.origin
    _, certificate = lpv_lmi(LORENZ, bounds=channels)
    assert any("simulation" in line for line in certificate.assumptions)
