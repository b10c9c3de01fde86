"""A function of small arrays taken apart into equations between numbers: of many lanes, or of one run (lanes = 0)."""

from jaxobs.scalars.flat import Equation as Equation
from jaxobs.scalars.flat import Program as Program
from jaxobs.scalars.flat import Variable as Variable
from jaxobs.scalars.flat import flatten as flatten
from jaxobs.scalars.flat import split as split
from jaxobs.scalars.flat import trace as trace
from jaxobs.scalars.program import WHOLE as WHOLE
from jaxobs.scalars.program import Entries as Entries
from jaxobs.scalars.program import Pack as Pack
from jaxobs.scalars.program import Value as Value
from jaxobs.scalars.program import Whole as Whole
from jaxobs.scalars.program import apply as apply
from jaxobs.scalars.program import as_whole as as_whole
from jaxobs.scalars.program import by_rule as by_rule
from jaxobs.scalars.program import differs as differs
from jaxobs.scalars.program import evaluate as evaluate
from jaxobs.scalars.program import lane_variables as lane_variables
from jaxobs.scalars.program import literal as literal
from jaxobs.scalars.program import small as small
from jaxobs.scalars.program import spread as spread
from jaxobs.scalars.program import through_vmap as through_vmap
from jaxobs.scalars.program import value_of as value_of
from jaxobs.scalars.rules import is_constant as is_constant
