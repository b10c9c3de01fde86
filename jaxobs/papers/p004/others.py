"""Section VI and VII: the systems that are only named, and the general statements."""

import functools

from jaxobs.designs import Infeasible, undetectable
from jaxobs.papers.claims import Statement
from jaxobs.papers.p004.paper import PAPER, as_text, attractor, certified_gain, seen_model


@functools.cache
def seen_through(kind: str, state: int) -> str:
    """What a constant gain can do with y = x_state, for slopes in the extremes of a simulated run."""
    if (point := undetectable(seen_model(kind, state))) is not None:
        return f"y = x{state}: no gain can work, {point}"
    try:
        gain = certified_gain(kind, state)
    except Infeasible as nothing:
        return f"y = x{state}: no common P was found (margin {nothing.margin:.2g})"
    return f"y = x{state}: L = {as_text(gain.T)}' has an exact certificate"


def outcome(kind: str, states: int) -> str:
    box = attractor(kind)
    span = "; ".join(f"x{i + 1} in [{lo:.3g}, {hi:.3g}]" for i, (lo, hi) in enumerate(zip(box.min(0), box.max(0), strict=True)))
    parts = "; ".join(seen_through(kind, state) for state in range(1, states + 1))
    return f"the output is not named. On the simulated box ({span}), conditional on staying there: {parts}"


@PAPER.claim("Section VI, Roessler system", "universal", printed="tested successfully", long=True)
def _():
    words = outcome("rossler", 3)
    return Statement(None, f"{words.count('exact certificate')} of 3 outputs certified", words)


@PAPER.claim("Section VI, Van der Pol oscillator", "universal", printed="tested successfully", long=True)
def _():
    words = outcome("van der pol", 2)
    return Statement(None, f"{words.count('exact certificate')} of 2 outputs certified", words)


@PAPER.claim("Section VI, examples of [22], [1], [9], [20]", "universal", printed="tested successfully")
def _():
    return Statement(None, "not given here", "neither these systems nor gains for them are in the paper")


@PAPER.claim("Section VII, conditions not restrictive", "universal", printed="not restrictive")
def _():
    words = seen_through("rossler", 1)
    why = f"a judgement, not decided here. Where the box holds an undetectable point they cannot be met: Roessler with {words}"
    return Statement(None, "no gain" if "no gain" in words else "a gain", why)
