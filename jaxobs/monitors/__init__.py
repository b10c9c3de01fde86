"""Run-time monitors: what a theorem promises, checked on the signals that an observer has while it runs.

A monitor that is broken refutes one of the theorem's hypotheses (the model, the Lipschitz constant, the bounds on noise and
initial error); one that is kept proves nothing.
"""

from jaxobs.monitors.corollaries import Budget as Budget
from jaxobs.monitors.corollaries import Envelope as Envelope
from jaxobs.monitors.corollaries import budget as budget
from jaxobs.monitors.corollaries import envelope as envelope
from jaxobs.monitors.corollaries import innovation_energy as innovation_energy
