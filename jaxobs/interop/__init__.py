"""Bridges to other packages: runs as xarray data sets, linear systems of python-control, both ways."""

from jaxobs.interop.datasets import to_dataset as to_dataset
from jaxobs.interop.linear import from_control as from_control
from jaxobs.interop.linear import to_control as to_control
