"""Recorded data, read with its flaws named; and the recorded walk that comes with the package."""

from jaxobs.datasets.csv import read_csv as read_csv
from jaxobs.datasets.walk import Walk as Walk
from jaxobs.datasets.walk import shank_walk as shank_walk
