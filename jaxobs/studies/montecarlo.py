"""Monte Carlo studies: every member of every family, under every seed, into one data set with named axes."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
import xarray as xr

from jaxobs._module import Numbers, refuse, require_integer
from jaxobs.integrators import AbstractIntegrator, ProgressMeter
from jaxobs.metrics import AbstractMetric
from jaxobs.studies.config import config
from jaxobs.studies.dataset import Memory, block, frame
from jaxobs.studies.groups import make_groups
from jaxobs.studies.kernel import LEAST, compile_group
from jaxobs.studies.memory import SHARE, free_memory
from jaxobs.studies.outputs import Lane
from jaxobs.studies.plan import Chunk, Plan, make_plan, parts_of
from jaxobs.studies.progress import Meter, Stop, check_progress, reporter, wait


def study(
    plant: Any,
    families: Any,
    *,
    ts: Numbers,
    metrics: Mapping[str, AbstractMetric],
    x0: Any,
    xhat0: Any,
    keys: Any = None,
    signal: Any = None,
    noise: Any = None,
    disturbance: Any = None,
    integrator: AbstractIntegrator | None = None,
    hold_innovation: bool = False,
    save: int | None = None,
    store: Any = None,
    part: tuple[int, int] | None = None,
    chunk: int | None = None,
    budget: int | None = None,
    tile: int = 512,
    progress: bool | Callable[..., Any] | ProgressMeter | None = None,
) -> xr.Dataset:
    """Every member under every seed: for all combinations of the axes below, the metrics of one simulated run.

    A run is that of `jaxobs.score` with the same numbers: plant from x0, observer from xhat0, over the grid ts, with noise and
    disturbance drawn from the lane's key. Seed s has the same key whatever the observer, the gain or the noise level is.

    families: an observer; a family of them, `jaxobs.grid(observer, gamma=gammas)`; several, `{label: observer or family}`,
    along the axis "observer"; or `jaxobs.variants(make, q=[0, 1, 2])`. The last two are compiled once for each entry, all else
    is lanes of one compiled loop. plant, signal, noise and disturbance: one, or a `grid` of it; the plant is the true one, and
    the observers' model may differ. The plant is None if the variants bring theirs.
    metrics: {name: metric}; the variable "diverged_at" [s] is always there, infinity where x and xhat stay finite. A lane that
    diverges has the time there, as a rule NaN or infinity in its metrics (ask diverged_at), and disturbs no other.
    x0, xhat0: (n,), or (members, n) for an axis of this name, or a function n -> one of these where variants change n.
    keys: PRNG keys along one axis, or `jaxobs.Seeds(key, count)`; needed with noise or disturbance.
    save: keep every save-th sample of x and xhat; None keeps no trajectories, and memory does not grow with time.
    store: a folder for the results (Zarr): the same call again computes only what is missing there. Else they are in memory.
    part: (i, count) computes chunks i, i + count, ... only, the share of one of `count` workers (under jax.distributed that of
    this process); the rest is NaN. chunk: the largest number of lanes stored together. budget: the bytes that may be worked on
    at once, a quarter of the free memory by default. tile: lanes advanced together, raised to 16, 32, 64, ... No number
    depends on these four, nor on the number of devices.
    progress: True for a bar, a function that is given a `Progress` after each piece of work, or a diffrax progress meter.

    Axes of the data set, in this order: "observer" or those of the variants; the leaves of the observers by their names in
    `grid` ("gamma", "model.a"), then those of plant, signal, noise and disturbance ("sigma", or "noise.sigma" where that is
    taken); "x0"; "xhat0"; "seed"; then those of the metric ("state", "output", "lag", "time"). An axis of vectors counts them
    and has the vectors beside it ("alphas_value"). Attributes have units, versions, precision and the whole configuration.

    Ctrl-C stops after the chunk in flight with KeyboardInterrupt, whose note says what is kept; a second one stops at once.
    ValueError names the argument that does not fit, before anything is compiled.
    """
    for name, value in (("tile", tile), ("chunk", chunk), ("budget", budget)):
        if value is not None or name == "tile":
            require_integer("study", name, value, 1, FIX[name])
    check_progress(progress)
    shape_axes, groups = make_groups(
        plant, families, ts=ts, metrics=metrics, x0=x0, xhat0=xhat0, keys=keys, signal=signal, noise=noise,
        disturbance=disturbance, integrator=integrator, hold_innovation=hold_innovation, save=save,
    )  # fmt: skip
    plan = make_plan(groups, shape_axes, chunk)
    if part is None and (workers := jax.process_count()) > 1:
        if store is None:
            fix = "Each computes its part of the study, and they meet there; without one give part=."
            raise refuse("study", "store", "None", f"a folder that all {workers} processes see", fix)
        part = (jax.process_index(), workers)
    parts_of(plan, part or (0, 1))
    plan, pieces, sink = _prepared(plan, config(groups, shape_axes), store, budget, tile)
    mine = parts_of(plan, part or (0, 1))
    finished = sink.done(mine)
    done, total = (sum(plan[index].count for index in which) for which in (finished, mine))
    with reporter(progress) as report:
        meter = Meter(report, total, done, len(groups[0].ts))
        _work(plan, [index for index in mine if index not in finished], sink, pieces, tile, meter, store)
    return sink.dataset()


FIX = {
    "tile": "It counts the lanes that are advanced together.",
    "chunk": "It bounds the lanes that are stored together; None finds it.",
    "budget": "It bounds the bytes that are worked on at once; None finds it.",
}


def _prepared(plan: Plan, config: dict[str, Any], store: Any, budget: int | None, tile: int) -> tuple[Plan, list[int], Any]:
    """The plan in the chunks that a store has, the lanes of each group that are computed at once, and where blocks go."""
    if store is None:
        size = sum(math.prod(v.shape) * v.dtype.itemsize for v in plan.variables.values())
        if size > free_memory():
            fix = "Give store=DIR, or fewer lanes, or a larger save."
            raise refuse("study", "store", "None", f"a folder for {size / 2**30:.3g} GiB of results, which memory has not", fix)
        return plan, [_piece(plan, lane, budget, tile) for lane in plan.lanes], Memory(frame(plan, config), plan)
    from jaxobs.studies.store import Store

    kept = Store.open(store, config)
    plan = plan if kept is None else plan.cut_as(kept.block)
    pieces = [_piece(plan, lane, budget, tile) for lane in plan.lanes]
    if kept is None:
        kept = Store.create(store, frame(plan, config), plan.variables, plan.block, config)
    return plan.cut_as(kept.block), pieces, kept


def _piece(plan: Plan, lane: Lane, given: int | None, tile: int) -> int:
    """The lanes that are computed at once: those of a chunk, or as many as the budget holds."""
    budget = free_memory() // SHARE if given is None else given
    lanes = math.prod(plan.block[axis.name] for axis in plan.groups[0].axes)
    most = (budget - lane.more * min(tile * jax.local_device_count(), lanes)) // lane.each
    if most < 1:
        most = budget // (lane.each + lane.more)
    if most < 1:
        source = f"1/{SHARE} of the free memory" if given is None else "given"
        fix = "Raise it, keep fewer samples (save=), or free memory."
        expected = f"the {lane.each + lane.more} bytes of one lane or more"
        raise refuse("study", "budget", f"{budget} bytes ({source})", expected, fix)
    return math.ceil(lanes / math.ceil(lanes / most))


def _work(plan: Plan, todo: list[int], sink: Any, pieces: list[int], tile: int, meter: Meter, store: Any) -> None:
    run: Any = None
    current, kept, new = -1, meter.done, True
    with Stop() as stop:
        try:
            for count, index in enumerate(todo):
                chunk = plan[index]
                if chunk.group != current:
                    current, new = chunk.group, True
                    run = compile_group(plan.groups[current], chunk=pieces[current], tile=whole_registers(tile))
                results = _compute(run, chunk, pieces[current], meter, new)
                sink.write(index, chunk.region, block(plan, chunk, results))
                kept, new = kept + chunk.count, False
                if stop.asked and count + 1 < len(todo):
                    raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            words = f"{kept} of {meter.total} lanes are finished"
            if store is None:
                error.dataset = sink.dataset()  # pyright: ignore[reportAttributeAccessIssue]: for who catches it
                error.add_note(f"study: {words}; they are in this exception's `dataset`. With store=DIR the call would go on.")
            else:
                error.add_note(f"study: {words} and kept in {store}; the same call goes on from there.")
            raise


def whole_registers(tile: int) -> int:
    """16, 32, 64, ...: a tile that does not fill the vector registers runs through other machine code, with other last bits."""
    return LEAST * 2 ** max(0, math.ceil(math.log2(tile / LEAST)))


def _compute(run: Any, chunk: Chunk, piece: int, meter: Meter, new: bool) -> dict[str, np.ndarray]:
    """The results of a chunk, piece by piece. Lanes beyond its end are computed with the last piece and left out."""
    found: list[dict[str, np.ndarray]] = []
    for start in range(chunk.start, chunk.start + chunk.count, piece):
        begun = time.perf_counter()
        out = run(start)
        wait(list(out.values()))
        lanes = min(piece, chunk.start + chunk.count - start)
        found.append({name: np.asarray(array)[:lanes] for name, array in out.items()})
        meter.add(lanes, time.perf_counter() - begun, compiled=new and not found[1:])
    return found[0] if len(found) == 1 else {name: np.concatenate([f[name] for f in found]) for name in found[0]}
