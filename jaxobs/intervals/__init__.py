"""Interval arithmetic over the jaxpr of a JAX function: proved enclosures of its values, and of its Jacobian, on a box.

The `rules_` modules fill the table RULES when they are imported; `rule` adds one of your own.
"""

from jaxobs.intervals import rules_arithmetic as rules_arithmetic
from jaxobs.intervals import rules_control as rules_control
from jaxobs.intervals import rules_indexing as rules_indexing
from jaxobs.intervals import rules_logic as rules_logic
from jaxobs.intervals import rules_reduce as rules_reduce
from jaxobs.intervals import rules_structure as rules_structure
from jaxobs.intervals.declared import require_derivatives as require_derivatives
from jaxobs.intervals.interval import Interval as Interval
from jaxobs.intervals.interval import hull as hull
from jaxobs.intervals.interval import point as point
from jaxobs.intervals.interval import whole as whole
from jaxobs.intervals.jacobian import JacobianBounds as JacobianBounds
from jaxobs.intervals.jacobian import jacobian_bounds as jacobian_bounds
from jaxobs.intervals.jaxpr import Bounded as Bounded
from jaxobs.intervals.jaxpr import Program as Program
from jaxobs.intervals.jaxpr import bound as bound
from jaxobs.intervals.jaxpr import bounded as bounded
from jaxobs.intervals.jaxpr import trace as trace
from jaxobs.intervals.table import RULES as RULES
from jaxobs.intervals.table import Call as Call
from jaxobs.intervals.table import UnknownPrimitiveError as UnknownPrimitiveError
from jaxobs.intervals.table import rule as rule
