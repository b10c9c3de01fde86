"""How much time does a given accuracy cost? Fixed steps, exponential steps and adaptive steps on the same studies.

The pendulum without noise, with noise held over 0.1, and the stiff chain: high-gain observers with gains along the lanes. The
error of a method is that of the root mean square estimation errors it reports, relative, the worst over states and over the
lanes that have a reference: scipy's DOP853, from sample to sample, with an absolute tolerance that grows with the gain as the
estimates do. Those of the stiff chain peak and turn their sines as fast, which a tolerance far below 1e-10 begins to follow:
there it is run at 1e-10, on the pendulum at 1e-13; how far ten times that moves the reference is printed.
All methods in float64, in one interleaved run; an adaptive method under vmap costs every lane its slowest one. scipy runs a few
lanes, one after the other.
Run: python benchmarks/work_precision.py [--figure FILE] [--json FILE] [--quick]
"""

import argparse
import dataclasses
import json
import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from _rival_diffrax import chain_field, pendulum_field
from scipy.integrate import solve_ivp

import jaxobs
from jaxobs.integrators import RK4, Adaptive, Exponential
from jaxobs.studies.devices import use_all_cores
from jaxobs.studies.groups import make_groups
from jaxobs.studies.kernel import compile_group

REFERENCES = 4  # lanes with a reference, spread over the gains; scipy runs the first and the last of them


@dataclasses.dataclass(frozen=True)
class Case:
    """A study: sampling period [s], samples, start of truth and estimate, gains, noise a sin(w t_k) held over the period."""

    title: str
    period: float
    samples: int
    x0: tuple[float, ...]
    xhat0: tuple[float, ...]
    gains: tuple[float, float]
    amplitude: float
    field: Callable[..., Any]
    substeps: tuple[int, ...]
    finest: float = 1e-13  # tolerance of the reference

    def ts(self) -> np.ndarray:
        return self.period * np.arange(self.samples)

    def noise(self) -> np.ndarray:
        return self.amplitude * np.sin(FREQUENCY * self.ts())


FREQUENCY = 40.0  # [rad/s], far above the sampling rate: the samples jump about as noise does, and are the same for everybody
PENDULUM = {"period": 0.1, "samples": 100, "x0": (0.5, 0.0), "xhat0": (0.0, 0.0), "gains": (2.0, 6.0), "field": pendulum_field}
CASES = (
    Case("pendulum", amplitude=0.0, substeps=(1, 4, 16), **PENDULUM),
    Case("pendulum, held noise", amplitude=0.1, substeps=(1, 4, 16), **PENDULUM),
    Case("stiff chain, held noise", 0.05, 40, (0.1,) * 5, (0.0,) * 5, (20.0, 50.0), 0.1, chain_field, (4, 8, 16), 1e-10),
)
TOLERANCES = (1e-3, 1e-6, 1e-9)


def jaxobs_study(case: Case, gains: np.ndarray, integrator: Any) -> Callable[[], np.ndarray]:
    """rmse (n, lanes) by the compiled loop of jaxobs.study, without its checks and its data set, as the others have none."""
    chain = len(case.x0) == 5
    plant = jaxobs.plants.SineChain(1.0, 5) if chain else jaxobs.plants.Pendulum()
    observer = jaxobs.observers.HighGain(plant, jaxobs.hurwitz.binomial(5) if chain else np.asarray([3.0, 2.0]), 1.0)
    family = jaxobs.Family(observer, (jnp.asarray(gains),), ("gamma",))
    signal = None if chain else jaxobs.signals.Sine(0.5)
    keys = jaxobs.Seeds(jax.random.key(0), 1) if case.amplitude else None
    noise = jaxobs.noise.Sinusoid(case.amplitude, FREQUENCY) if case.amplitude else None

    _, (group,) = make_groups(
        plant, family, ts=case.ts(), metrics={"rmse": jaxobs.metrics.RMSE()}, x0=case.x0, xhat0=case.xhat0, keys=keys,
        signal=signal, noise=noise, disturbance=None, integrator=integrator, hold_innovation=False, save=None,
    )  # fmt: skip
    run = compile_group(group, chunk=len(gains))
    return lambda: np.asarray(run(0)["rmse"]).T


def diffrax_study(case: Case, gains: np.ndarray, solver: Any, tolerance: float) -> Callable[[], np.ndarray]:
    """The same by one adaptive diffeqsolve for each lane, under vmap; the samples of the noise are announced as jumps."""
    ts, noise = jnp.asarray(case.ts()), jnp.asarray(case.noise())
    controller: Any = diffrax.PIDController(rtol=tolerance, atol=tolerance / 10)
    if case.amplitude:
        controller = diffrax.ClipStepSizeController(controller, jump_ts=ts[1:])

    def field(t, q, gamma):
        return case.field(t, q, (noise[jnp.searchsorted(ts, t, side="right") - 1], gamma))

    def lane(gamma):
        path = diffrax.diffeqsolve(
            diffrax.ODETerm(field), solver, 0.0, ts[-1], case.period / 10, (*case.x0, *case.xhat0), gamma, max_steps=2**16,
            stepsize_controller=controller, saveat=diffrax.SaveAt(ts=ts), throw=False,
        ).ys  # fmt: skip
        q = jnp.stack(path)
        return jnp.sqrt(jnp.mean((q[len(case.x0) :] - q[: len(case.x0)]) ** 2, axis=1))

    study, lanes = jax.jit(jax.vmap(lane, out_axes=1)), jnp.asarray(gains)
    return lambda: np.asarray(study(lanes))


def scipy_study(case: Case, gains: np.ndarray, method: str, tolerance: float, *, scaled: bool = False):
    """The same by solve_ivp, lane by lane; from sample to sample where the noise jumps, in one go where there is none.

    `scaled`: the absolute tolerance of estimate i is gamma^(i - 1) times that of the first, instead of the same for all.
    """
    ts, noise, n = case.ts(), case.noise(), len(case.x0)

    def chain(t, q, w, gamma):
        e = q[0] + w - q[5]
        s = np.sin(q)
        gain = [math.comb(5, i) * gamma**i * e for i in range(1, 6)]
        return [
            *q[1:5],
            s[:5].sum() / 5,
            q[6] + gain[0],
            q[7] + gain[1],
            q[8] + gain[2],
            q[9] + gain[3],
            s[5:].sum() / 5 + gain[4],
        ]

    def pendulum(t, q, w, gamma):
        u, e = 0.5 * math.sin(t), q[0] + w - q[2]
        first = q[3] + 3 * gamma * e
        return [q[1], math.sin(q[0]) + u * math.cos(q[0]), first, math.sin(q[2]) + u * math.cos(q[2]) + 2 * gamma**2 * e]

    field = chain if n == 5 else pendulum

    def lane(gamma):
        start = np.asarray((*case.x0, *case.xhat0))
        sizes = np.concatenate([np.ones(n), gamma ** np.arange(n)]) if scaled else np.ones(2 * n)
        steps = {"method": method, "rtol": max(tolerance, 2.3e-14), "atol": tolerance / 10 * sizes}
        if not case.amplitude:
            q = solve_ivp(field, (0, ts[-1]), start, t_eval=ts, args=(0.0, gamma), **steps).y
        else:
            states = [start]
            for t, w in zip(ts[:-1], noise[:-1], strict=True):
                states.append(solve_ivp(field, (t, t + case.period), states[-1], args=(w, gamma), **steps).y[:, -1])
            q = np.stack(states, axis=1)
        return np.sqrt(np.mean((q[n:] - q[:n]) ** 2, axis=1))

    return lambda: np.stack([lane(gamma) for gamma in gains], axis=1)


@dataclasses.dataclass
class Point:
    """One method at one setting: time in ns per lane-sample of each round, worst relative error."""

    method: str
    setting: str
    run: Callable[[], np.ndarray]
    lanes: int
    times: list[float] = dataclasses.field(default_factory=list)
    error: float = math.nan

    @property
    def time(self) -> float:
        return statistics.median(self.times)


def points_of(case: Case, gains: np.ndarray, few: np.ndarray) -> list[Point]:
    points = [Point("jaxobs RK4", f"{k} substeps", jaxobs_study(case, gains, RK4(k)), len(gains)) for k in case.substeps]
    for k in (1, 2, 4):
        points.append(Point("jaxobs Exponential", f"{k} substeps", jaxobs_study(case, gains, Exponential(k)), len(gains)))
    for tolerance in (one for one in TOLERANCES if one > 10 * case.finest):
        name = f"{tolerance:.0e}"
        adaptive = Adaptive(rtol=tolerance, atol=tolerance / 10)
        points.append(Point("jaxobs Adaptive", name, jaxobs_study(case, gains, adaptive), len(gains)))
        points.append(Point("diffrax Tsit5", name, diffrax_study(case, gains, diffrax.Tsit5(), tolerance), len(gains)))
        for method in ("RK45", "LSODA"):
            points.append(Point(f"scipy {method}", name, scipy_study(case, few, method, tolerance), len(few)))
    return points


def measure(case: Case, lanes: int, rounds: int) -> list[Point]:
    """The points of one case, timed; prints what its reference is worth."""
    gains = np.linspace(*case.gains, lanes)
    known = np.linspace(0, lanes - 1, REFERENCES).astype(int)
    few = known[[0, -1]]
    reference, coarser = (scipy_study(case, gains[known], "DOP853", k * case.finest, scaled=True)() for k in (1, 10))
    print(f"\n{case.title}: the reference moves by {np.max(np.abs(coarser / reference - 1)):.1e} at ten times its tolerance")
    points = points_of(case, gains, gains[few])
    for point in points:
        rmse = point.run()  # compiles
        mine, true = (rmse[:, known], reference) if point.lanes == lanes else (rmse, reference[:, [0, -1]])
        point.error = float(np.max(np.abs(mine / true - 1)))
    for turn in range(rounds):
        for point in points:
            if turn and point.lanes < lanes:
                continue  # scipy: seconds, once
            begin = time.perf_counter()
            point.run()
            point.times.append((time.perf_counter() - begin) / (point.lanes * case.samples) * 1e9)
    return points


def draw(results: dict[str, list[Point]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(results), figsize=(5 * len(results), 4.6), layout="constrained", squeeze=False)
    for axis, (title, points) in zip(axes[0], results.items(), strict=True):
        for name, marker in zip(dict.fromkeys(p.method for p in points), "os^vDP", strict=False):
            line = [p for p in points if p.method == name and p.error < 1]
            axis.loglog([p.error for p in line], [p.time for p in line], marker=marker, label=name)
        axis.set(title=title, xlabel="relative error of the RMSE, worst lane and state", ylabel="ns per lane and sample")
        axis.invert_xaxis()
        axis.grid(alpha=0.3)
    axes[0][0].legend(fontsize=8)
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lanes", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="64 lanes, 1 round")
    parser.add_argument("--case", choices=[case.title for case in CASES], nargs="+", help="these alone")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    use_all_cores()
    jax.config.update("jax_enable_x64", True)
    lanes, rounds = (64, 1) if options.quick else (options.lanes, options.rounds)
    results = {}
    for case in (case for case in CASES if not options.case or case.title in options.case):
        results[case.title] = measure(case, lanes, rounds)
        print(f"\n{case.title}: {lanes} lanes x {case.samples} samples {case.period:g} s apart, float64")
        for point in results[case.title]:
            error = f"{point.error:.1e}" if point.error < 1e3 else "diverged"
            print(f"  {point.method:20}{point.setting:>12}{point.time:12.4g} ns per lane-sample   error {error}", flush=True)
    if options.figure:
        draw(results, options.figure)
    if options.json:
        record = {t: [{k: v for k, v in vars(p).items() if k != "run"} for p in ps] for t, ps in results.items()}
        options.json.write_text(json.dumps(record, indent=1))


if __name__ == "__main__":
    main()
