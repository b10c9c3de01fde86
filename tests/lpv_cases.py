"""Plants, bounds and channels of the LPV tests."""

import numpy as np

from jaxobs import plants
from jaxobs.designs import Channels

T = 0.001
LOW, HIGH = np.array([-30.0, -30.0, -2.0]), np.array([30.0, 30.0, 58.0])
LORENZ = plants.Lorenz()


def arrays(kind, *values, **others):
    return kind(*(np.asarray(value, float) for value in values), **others)


def lorenz_entries(low=LOW, high=HIGH):
    return tuple(np.array([[x[2], 0, x[0]], [x[1], x[0], 0]]) for x in (low, high))


def joint_channels(angle):
    return arrays(Channels, np.eye(2), [[-1, 0, 1, 0], [0, 0, 1, 0]], [0, -1], [3 * angle**2, 1])


def saturated():
    return plants.Saturated(LORENZ, LOW, HIGH)
