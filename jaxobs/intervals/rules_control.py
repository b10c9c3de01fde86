"""Rules of equations that carry jaxprs: calls, custom derivatives, checkpoints, scan, while and cond."""

import functools

import numpy as np

from jaxobs.intervals.interval import Interval, hull, interval
from jaxobs.intervals.table import Call, rule, undecided

MAX_TURNS = 100_000


@rule("jit", "closed_call", "core_call", "remat2", "custom_jvp_call", "custom_vjp_call")
def _call(call: Call, *args: Interval) -> list[Interval]:
    """The function itself; a custom derivative is its author's claim about it, not part of the value."""
    return call.run(call, call.params["call_jaxpr" if "call_jaxpr" in call.params else "jaxpr"], args)


@rule("cond")
def _cond(call: Call, which: Interval, *args: Interval) -> list[Interval]:
    """The branch taken, or the hull of those that may be."""
    branches = call.params["branches"]
    first, last = (int(np.clip(z, 0, len(branches) - 1)) for z in (which.lower, which.upper))
    if first != last:
        call.jump("the branch")
    results = [call.run(call, branch, args) for branch in branches[first : last + 1]]
    return [functools.reduce(hull, each) for each in zip(*results, strict=True)]


@rule("scan")
def _scan(call: Call, *args: Interval) -> list[Interval]:
    """Each step in turn: carry, y = body(consts, carry, x)."""
    p = call.params
    constants, carry = args[: p["num_consts"]], list(args[p["num_consts"] : p["num_consts"] + p["num_carry"]])
    xs = args[p["num_consts"] + p["num_carry"] :]
    turns = range(p["length"])
    ys: list[list[Interval]] = []
    for i in reversed(turns) if p["reverse"] else turns:
        results = call.run(call, p["jaxpr"], [*constants, *carry, *[x[i] for x in xs]])
        carry = results[: p["num_carry"]]
        ys.append(results[p["num_carry"] :])
    ys = ys[::-1] if p["reverse"] else ys
    if not ys:
        outs = call.eqn.outvars[p["num_carry"] :]
        return [*carry, *[interval(np.zeros(v.aval.shape), np.zeros(v.aval.shape)) for v in outs]]
    stacked = [interval(np.stack([y.lower for y in each]), np.stack([y.upper for y in each])) for each in zip(*ys, strict=True)]
    return [*carry, *stacked]


@rule("while")
def _while(call: Call, *args: Interval) -> list[Interval]:
    """Turn by turn while the condition is certainly true; refused where the box does not decide it."""
    p = call.params
    of_cond, of_body = args[: p["cond_nconsts"]], args[p["cond_nconsts"] : p["cond_nconsts"] + p["body_nconsts"]]
    state = list(args[p["cond_nconsts"] + p["body_nconsts"] :])
    for _ in range(MAX_TURNS):
        (go_on,) = call.run(call, p["cond_jaxpr"], [*of_cond, *state])
        if undecided(go_on):
            raise call.refuse(
                "the box does not decide how many turns the loop takes",
                "Write it as lax.scan or lax.fori_loop of fixed length, or split the box.",
            )
        if not np.any(go_on.lower):
            return state
        state = call.run(call, p["body_jaxpr"], [*of_body, *state])
    raise call.refuse(f"the loop takes more than {MAX_TURNS} turns", "Bound one turn and reason about the rest.")
