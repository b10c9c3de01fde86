"""Memory is lanes x states, not lanes x time: peak memory and cost of a lane's step, over lanes and over steps.

python benchmarks/memory.py                                 4,096 to 1e6 lanes, 100 to 1,000 steps
python benchmarks/memory.py --lanes 1000000 --steps 100000  one long run
"""

import json
import resource
import subprocess
import sys
import time

import tyro
from rich.console import Console
from rich.table import Table

LADDER = [(4096, 1000), (65_536, 1000), (1_000_000, 100), (1_000_000, 1000)]


def main(lanes: int = 0, steps: int = 0, precision: str = "float32", noise: bool = True, as_json: bool = False) -> None:
    """Each size in a process of its own, which runs once to compile (a few steps) and once for the figures."""
    sizes = [(lanes or 4096, steps or 1000)] if lanes or steps else LADDER
    rows = [_measured(*size, precision, noise) for size in sizes]
    if as_json:
        print(json.dumps(rows))
        return
    table = Table("lanes", "steps", "seconds", "ns per lane-step", "peak MiB before", "peak MiB after")
    for row in rows:
        table.add_row(*(f"{row[key]:,.6g}" for key in ("lanes", "steps", "seconds", "ns", "before", "after")))
    Console().print(table)


def _measured(lanes: int, steps: int, precision: str, noise: bool) -> dict[str, float]:
    command = [sys.executable, __file__, "--child", str(lanes), str(steps), precision, str(int(noise))]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def _child(lanes: int, steps: int, precision: str, noise: bool) -> None:
    import jax
    import jax.numpy as jnp
    import numpy as np

    import jaxobs

    jaxobs.use_all_cores(fuse=True)
    jax.config.update("jax_enable_x64", precision == "float64")
    plant = jaxobs.plants.Pendulum()
    observer = jaxobs.observers.HighGain(plant, [3.0, 2.0], 6.0)
    gammas = np.geomspace(4, 20, 64)

    def run(steps: int) -> None:
        jaxobs.study(
            plant, jaxobs.grid(observer, gamma=gammas), keys=jaxobs.Seeds(jax.random.key(0), lanes // len(gammas)),
            x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=np.arange(steps) * 0.01, signal=jaxobs.signals.Sine(0.5),
            noise=jaxobs.noise.Gaussian(0.1) if noise else None, metrics={"rmse": jaxobs.metrics.RMSE(steps * 0.005)},
        )  # fmt: skip

    jnp.zeros(()).block_until_ready()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    for _ in range(2 if steps <= 1000 else 1):  # a short run once more, without compiling
        start = time.perf_counter()
        run(steps)
        seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    done = lanes // len(gammas) * len(gammas)
    cost = {"seconds": seconds, "ns": seconds / done / steps * 1e9}
    print(json.dumps({"lanes": done, "steps": steps, "before": before, "after": after} | cost))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        _child(int(sys.argv[2]), int(sys.argv[3]), sys.argv[4], sys.argv[5] == "1")
    else:
        tyro.cli(main)
