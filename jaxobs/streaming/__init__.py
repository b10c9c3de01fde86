"""Observers one sample at a time, as a controller has them."""

from jaxobs.streaming.irregular import IrregularRunner as IrregularRunner
from jaxobs.streaming.runner import Runner as Runner
