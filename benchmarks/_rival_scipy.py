"""scipy, one trajectory after the other: solve_ivp's RK45, held to the steps of the grid (first_step = max_step = dt, loose
tolerances). It has no classical RK4 and works in float64 only. With noise the same solver object is stepped by hand, so that
w_k is held over the step. A few lanes stand for all: the time of a lane does not depend on their number.
"""

import numpy as np
from _job import ALPHAS, Job
from scipy.integrate import RK45, solve_ivp

LANES = 2
LOOSE = {"rtol": 1e3, "atol": 1e3}


def prepare(job: Job):
    lanes = np.linspace(0, job.lanes - 1, LANES).astype(int)
    gains = job.lane_gains()[lanes]

    def run():
        rng = np.random.default_rng(job.seed)
        return np.stack([_lane(job, gain, rng) for gain in gains], axis=1), lanes

    return run


def _lane(job: Job, gamma: float, rng: np.random.Generator) -> np.ndarray:
    g1, g2 = ALPHAS[0] * gamma, ALPHAS[1] * gamma**2
    dt, steps = job.study.dt, job.steps
    w = 0.0

    def field(t, q):
        u, e = 0.5 * np.sin(t), q[0] + w - q[2]
        c, s = np.cos(q[0]), np.sin(q[0])
        return [q[1], s + u * c, q[3] + g1 * e, np.sin(q[2]) + u * np.cos(q[2]) + g2 * e]

    start, end = [*job.study.x0, *job.study.xhat0], (steps - 0.5) * dt  # the last step is half a step short of the next sample
    if job.sigma == 0:
        path = solve_ivp(field, (0, end), start, method="RK45", first_step=dt, max_step=dt, **LOOSE).y[:, :steps]
    else:
        solver, states = RK45(field, 0, start, end, first_step=dt, max_step=dt, **LOOSE), []
        for _ in range(steps):
            w = job.sigma * rng.standard_normal()
            solver.f = solver.fun(solver.t, solver.y)  # the solver would go on with the last value, which saw the last noise
            states.append(solver.y)
            solver.step()
        path = np.stack(states, axis=1)
    assert path.shape[1] == steps, path.shape
    return np.sqrt(np.mean((path[2:] - path[:2])[:, job.first :] ** 2, axis=1))
