"""A figure that the paper does not have: what the ten inputs do to the conditions."""

import numpy as np

from jaxobs.excitation import fading_gramians
from jaxobs.excitation.gramian import pair_of
from jaxobs.papers.p003.inputs import INPUTS
from jaxobs.papers.pictures import Line, Panel, Picture
from jaxobs.plants import GatedChain

SHOWN = ("1", "cos t", "max(0, sin(pi t/2))", "a bump, then 0")
THETA = 4.0


def inputs_picture() -> Picture:
    """lambda_min(Psi(t, 4)) and the least alpha with Gamma <= alpha Psi over time."""
    floors, alphas = [], []
    for name in SHOWN:
        one = INPUTS[name]
        grid = np.unique(np.concatenate([np.linspace(0, 16.0, 513), [b for b in one.breaks if b < 16.0]]))
        gramians = fading_gramians(pair_of("p003", GatedChain(), one.signal), grid, np.asarray([THETA]))
        seen = grid > 0.25
        floors.append(Line(f"u = {name}", grid[seen], gramians.smallest()[seen, 0]))
        alphas.append(Line(f"u = {name}", grid[seen], gramians.coupling()[seen, 0]))
    caption = "Example 1 at theta = 4: definition 2 i) sees nothing of a lost state, iii) does. A figure of ours."
    return Picture(
        "003_inputs",
        caption,
        (
            Panel("iii): smallest eigenvalue of Psi", "t [s]", "c", tuple(floors), yscale="log", ylim=(1e-20, 1.0)),
            Panel("i): least alpha with Gamma <= alpha Psi", "t [s]", "alpha", tuple(alphas), yscale="log", ylim=(0.9, 100.0)),
        ),
    )
