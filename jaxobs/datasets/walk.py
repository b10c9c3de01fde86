"""29 s of walking, recorded by an inertial sensor on the lower leg."""

from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np

from jaxobs.datasets.csv import read_csv


class Walk(NamedTuple):
    """ts [s]; angle [rad], the shank angle from the magnetometer alone: noisy, distorted; rate [rad/s], from the gyroscope."""

    ts: np.ndarray
    angle: np.ndarray
    rate: np.ndarray


def shank_walk() -> Walk:
    """3,511 samples at 120 samples/s: the measurement angle = unwrap(atan2(mag_y, mag_x)) and, from another sensor, its rate.

    The gyroscope's -gyro_z is the independent truth of what an observer of the angle should estimate. Source: the data of
    scikit-kinematics (T. Haslwanter), BSD-3-Clause; the licence lies beside the file.
    """
    with as_file(files("jaxobs.datasets") / "shank_walk.csv") as path:
        columns = read_csv(path, ["time_s", "mag_x", "mag_y", "gyro_z_rad_s"], time="time_s")
    angle = np.unwrap(np.arctan2(columns["mag_y"], columns["mag_x"]))
    return Walk(columns["time_s"], angle, -columns["gyro_z_rad_s"])
