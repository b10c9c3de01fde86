"""A small study, for the tests of what comes before one is compiled."""

import jax
import numpy as np

from jaxobs import Seeds, grid, metrics, observers, plants
from jaxobs.studies.groups import make_groups

PLANT = plants.Pendulum()
OBSERVER = observers.HighGain(PLANT, [1.5, 1.0], 3.0)
FAMILY = grid(OBSERVER, gamma=[2.0, 3.0])
KEYS = Seeds(jax.random.key(0), 3)
GIVEN = {
    "ts": np.linspace(0, 1, 11), "metrics": {"rmse": metrics.RMSE()}, "x0": [0.5, 0.0], "xhat0": [0, 0], "keys": None,
    "signal": None, "noise": None, "disturbance": None, "integrator": None, "hold_innovation": False, "save": None,
}  # fmt: skip
NEEDED = {name: GIVEN[name] for name in ("ts", "metrics", "x0", "xhat0")}


def groups(plant=PLANT, families=FAMILY, **given):
    return make_groups(plant, families, **(GIVEN | given))
