"""The wheel in a clean environment outside of the tree: `make wheel`.

    build the wheel -> a new venv with its dependencies at their lower bounds (requirements-lowest.txt) -> use it there

as someone does who has only `pip install jaxobs`: the command line, a stored certificate, the README's example, and a part of
the tests. The upper end of the bounds is requirements.lock, under which everything else runs. Not a test of pytest's: it needs
a package index.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parent.parent
TESTS = ("test_hurwitz", "test_linalg", "test_metrics", "test_observe", "test_study_store")
HELPERS = ("conftest.py", "cases.py", "study_cases.py", "study_stores.py", "oracles")
STORED = "sampled.json"  # one of notebooks/certificates


def run(*command: str | Path, cwd: Path, quiet: bool = False) -> None:
    """Shows the command and runs it; its failure ends everything."""
    print("$", *(Path(command[0]).name, *command[1:]), flush=True)
    sink = subprocess.DEVNULL if quiet else None
    alone = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "MAKEFLAGS"}}
    subprocess.run([str(part) for part in command], cwd=cwd, env=alone, stdout=sink, check=True)


def example(folder: Path) -> Path:
    """The program of the README."""
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    path = folder / "example.py"
    path.write_text(code, encoding="utf-8")
    return path


def tests(folder: Path) -> list[str]:
    """A part of the tests, away from the source: what they import is what is installed."""
    target = folder / "tests"
    target.mkdir()
    for name in (*HELPERS, *(f"{test}.py" for test in TESTS)):
        source = ROOT / "tests" / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, target / name)
    shutil.copy(ROOT / "pyproject.toml", folder)
    shutil.copytree(ROOT / "notebooks" / "certificates", folder / "notebooks" / "certificates")
    return [f"tests/{test}.py" for test in TESTS]


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="jaxobs-wheel-") as name:
        folder = Path(name)
        run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder / "dist", cwd=ROOT)
        (wheel,) = (folder / "dist").glob("*.whl")
        venv.create(folder / "venv", with_pip=True)
        at = folder / "venv" / "bin"
        pip = (at / "python", "-m", "pip", "--disable-pip-version-check", "-q")
        run(*pip, "install", "--require-hashes", "-r", ROOT / "requirements-lowest.txt", cwd=folder)
        run(*pip, "install", "--no-deps", wheel, cwd=folder)
        run(*pip, "check", cwd=folder)
        run(at / "jaxobs", "--help", cwd=folder, quiet=True)
        run(at / "jaxobs", "verify", ROOT / "notebooks" / "certificates" / STORED, cwd=folder)
        run(at / "jaxobs", "certify", "pendulum", "-o", folder / "pendulum.json", cwd=folder)
        run(at / "python", example(folder), cwd=folder)
        run(at / "python", "-m", "pytest", "-q", "-m", "not slow", "-p", "no:cacheprovider", *tests(folder), cwd=folder)
    print(f"{wheel.name}: installed and used at the lower bounds of its dependencies")


if __name__ == "__main__":
    main()
