"""The checkers are what they say: short, of the standard library alone, and they need no jaxobs to judge a file."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import mutation_seeds
import mutations
import pytest

CERTIFICATES = Path(mutations.checker.__file__).parent
CHECKERS = sorted(path.name for path in CERTIFICATES.glob("checker*.py"))
ALONE = ("checker.py", "checker_bounds.py")  # the others import their neighbours, from the package or from the same folder


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A certificate of every theorem, and one that is false, in a folder of their own."""
    folder = tmp_path_factory.mktemp("files")
    seeds = {data["theorem"]: data for data in mutation_seeds.seeds() if data["theorem"] in mutations.checker.THEOREMS}
    for theorem, data in seeds.items():
        (folder / f"{theorem}.json").write_text(json.dumps(mutations.signed(data)), encoding="utf-8")
    false = mutations.signed(seeds["corners"] | {"rate": (64.0).hex()})
    (folder / "false.json").write_text(json.dumps(false), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """A folder with the checkers and nothing else."""
    folder = tmp_path_factory.mktemp("alone")
    for name in CHECKERS:
        (folder / name).write_text((CERTIFICATES / name).read_text(encoding="utf-8"), encoding="utf-8")
    return folder


def run(alone, checker, *paths):
    """Without site-packages (-S) and isolated (-I, which would hide checker.py from checker_more.py)."""
    isolated = ["-I"] if checker in ALONE else ["-E", "-s"]
    command = [sys.executable, *isolated, "-S", checker, *map(str, paths)]
    return subprocess.run(command, cwd=alone, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize("name", CHECKERS)
def test_a_checker_is_short_and_imports_the_standard_library_only(name):
    source = (CERTIFICATES / name).read_text(encoding="utf-8")
    lines = source.splitlines()
    assert len(lines) <= 250
    assert max(map(len, lines)) <= 128
    imported = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add((node.module or "").split(".")[0])
    neighbours = set() if name in ALONE else {"jaxobs", *(Path(one).stem for one in CHECKERS)}
    assert imported <= set(sys.stdlib_module_names) | neighbours
    names = {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)}
    assert not names & {"eval", "exec", "compile", "__import__", "open", "globals", "input"}


def test_every_theorem_is_accepted_without_jaxobs(alone, files):
    paths = sorted(path for path in files.iterdir() if path.stem != "false")
    result = run(alone, "checker_more.py", *paths)
    assert result.returncode == 0, result.stdout + result.stderr
    assert not result.stderr
    assert {path.stem for path in paths} == set(mutations.checker.THEOREMS)
    for path in paths:
        assert f"{path}: holds for the stored model and bounds" in result.stdout
        data = json.loads(path.read_text(encoding="utf-8"))
        assert f"claim: {data['claim']}" in result.stdout
        assert all(f"assumes: {text}" in result.stdout for text in data["assumptions"])


def test_checker_alone_decides_its_own_theorems(alone, files):
    for theorem in ("corners", "step-corners", "h2", "l2"):
        result = run(alone, "checker.py", files / f"{theorem}.json")
        assert result.returncode == 0, result.stdout + result.stderr
        assert "holds for the stored model and bounds" in result.stdout
    other = run(alone, "checker.py", files / "no-gain.json")
    assert other.returncode == 1
    assert "checker_more.py" in other.stdout or "theorem" in other.stdout


def test_exit_codes_of_the_checker(alone, files, tmp_path):
    assert run(alone, "checker_more.py", files / "corners.json").returncode == 0
    false = run(alone, "checker_more.py", files / "false.json", files / "corners.json")
    assert false.returncode == 1
    assert "not certified: " in false.stdout
    assert "unstable" not in false.stdout.replace("false.json", "")
    nothing = run(alone, "checker_more.py")  # a pattern without files is no proof
    assert nothing.returncode == 1
    assert "Usage: " in nothing.stderr
    (tmp_path / "none.json").write_text("no", encoding="utf-8")
    assert run(alone, "checker_more.py", tmp_path / "none.json", files / "corners.json").returncode == 2


def test_jaxobs_is_not_there(alone):
    code = "import importlib.util as u, sys; sys.exit(any(u.find_spec(n) for n in ('jaxobs', 'jax', 'numpy', 'flint')))"
    result = subprocess.run([sys.executable, "-E", "-s", "-S", "-c", code], cwd=alone, check=False, timeout=60)
    assert result.returncode == 0
