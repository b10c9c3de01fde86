"""Observers that leave Python with their proof: C99, NumPy and StableHLO, from the one function of a sample."""

from jaxobs.export.against import CodeFile as CodeFile
from jaxobs.export.against import differences as differences
from jaxobs.export.against import read_c as read_c
from jaxobs.export.coverage import Coverage as Coverage
from jaxobs.export.coverage import coverage as coverage
from jaxobs.export.numpy_file import NumpyStep as NumpyStep
from jaxobs.export.numpy_file import numpy_step as numpy_step
from jaxobs.export.package import Exported as Exported
from jaxobs.export.package import export as export
from jaxobs.export.proof import prove as prove
from jaxobs.export.straight import Straight as Straight
from jaxobs.export.straight import straight as straight
from jaxobs.export.tick import Tick as Tick
from jaxobs.export.unrolled import Unsupported as Unsupported
from jaxobs.export.vectors import Vectors as Vectors
from jaxobs.export.vectors import ulps as ulps
from jaxobs.export.vectors import vectors as vectors
