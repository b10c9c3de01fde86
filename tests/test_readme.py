"""The README's example runs as printed, and is as short as it says."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from oracles import riccati

import jaxobs

README = Path(__file__).parent.parent / "README.md"


def test_example_runs_in_a_fresh_interpreter():
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    assert len([line for line in code.splitlines() if line.strip()]) <= 20
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "exact arithmetic" in done.stdout
    assert "d RMSE / d gamma" in done.stdout


def test_contributing_examples_work():
    """The plant, the observer and the design of CONTRIBUTING.md, put together."""
    text = (README.parent / "CONTRIBUTING.md").read_text()
    made = {}
    for code in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(code, "CONTRIBUTING.md", "exec"), made)
    plant = made["Damped"]()
    observer, certificate = made["twice_as_fast"](plant, lipschitz=1.01)
    assert certificate.verify()
    assert float(observer.gamma) == pytest.approx(2 * riccati.smallest_gamma([2.0, 1.0], 1.01), rel=1e-9)
    run = jaxobs.simulate(plant, made["Proportional"](plant, 1.0), x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=np.arange(0, 10, 0.05))
    assert np.abs(run.xhat[-1] - run.x[-1]).max() < 1e-2


def test_pictures_and_links_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", README.read_text()):
        assert (README.parent / target).exists(), target
