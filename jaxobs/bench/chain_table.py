"""The chain of paper 002, x_5' = (k_f / 5) sum_i sin x_i: printed gains, HG/LMI ones, and ours at the same proved rate."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence

import jax.numpy as jnp
import numpy as np

from jaxobs.bench.rows import Pair, Problem, beside, given
from jaxobs.certificates import NoHighGainLmi
from jaxobs.designs import H2, high_gain_lmi, lpv_model, slope_entries
from jaxobs.papers.p002 import shared
from jaxobs.papers.p002.paper import N
from jaxobs.plants import SineChain

STRENGTHS = (1, 10, 100)  # k_f of table I
PRINTED, HONEST = (0, 1, 2, 3), (1, 2, 3, 4)  # j0
ORIGIN = "the slope of (k_f / n) sin lies within k_f / n of 0"

Report = Callable[[str], None]


def chain(n: int, k_f: float | int) -> Problem:
    """The error of the observer of the chain of n states: n channels (k_f / n) cos, one a state, all into the last. What counts
    is E |e|^2 under unit measurement noise and unit noise where the slopes enter, as an error of the model would."""
    low, high = shared.bounds(k_f, n).T[:, None, :]
    plant, objective = SineChain(jnp.asarray(float(k_f)), n), H2(weight=np.eye(n), process=np.eye(n)[:, -1:], noise=np.eye(1))
    return Problem(f"k_f = {k_f:g}", lpv_model(plant, slope_entries(low, high)), objective, ORIGIN)


def chain_pairs(
    k_f: int, *, printed: Sequence[int] = PRINTED, honest: Sequence[int] = HONEST, progress: Report = lambda what: None
) -> Iterator[Pair]:
    """The printed gains j0 = 0..3 (0: standard high gain), those of `high_gain_lmi` for j0 = 1..4 at 1.1 times the smallest
    theta that any gain has, and ours beside each."""
    problem = chain(N, k_f)
    for j0 in printed:
        progress(f"chain, {problem.name}: printed j0 = {j0}")
        one = shared.row(j0, k_f)
        theirs = given(problem, f"printed j0 = {j0}", shared.gain(one)[:, None])
        if theirs.rate is None and isinstance(found := shared.full_box(one), NoHighGainLmi) and found.verify():
            theirs = dataclasses.replace(theirs, verdict="no P exists (exact)", certificate=found)
        yield beside(problem, theirs)
    for j0 in honest:
        progress(f"chain, {problem.name}: HG/LMI j0 = {j0}")
        begin = time.perf_counter()
        _, proof = high_gain_lmi(shared.plant(k_f), bounds=shared.bounds(k_f), j0=j0)
        seconds = time.perf_counter() - begin
        name = f"HG/LMI j0 = {j0}, theta = {proof.theta:.4g}"
        yield beside(problem, given(problem, name, np.array(proof.gain)[:, None], seconds=seconds))
