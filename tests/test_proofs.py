"""The certificates in notebooks/: judged by the checkers alone, and made anew by running the notebook."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from jaxobs.certificates import checker_more

NOTEBOOKS = Path(__file__).parent.parent / "notebooks"
CHECKERS = Path(checker_more.__file__).parent
FILES = sorted((NOTEBOOKS / "certificates").glob("*.json"))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """A folder with the checkers and nothing else."""
    folder = tmp_path_factory.mktemp("alone")
    for path in CHECKERS.glob("checker*.py"):
        shutil.copy(path, folder)
    return folder


def run(folder, checker, files):
    command = [sys.executable, "-E", "-s", "-S", checker, *map(str, files)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)


def require_accepted(alone, files):
    result = run(alone, "checker_more.py", files)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.count(": holds for the stored model and bounds") == len(files)
    travelling = [path for path in files if "bounds" in json.loads(path.read_text(encoding="utf-8"))]
    assert travelling
    result = run(alone, "checker_bounds.py", travelling)
    assert result.returncode == 0, result.stdout + result.stderr


def test_the_stored_certificates_are_accepted_without_jaxobs(alone):
    require_accepted(alone, FILES)


def test_they_show_the_main_theorems():
    shown = {json.loads(path.read_text(encoding="utf-8"))["theorem"] for path in FILES}
    assert shown <= set(checker_more.THEOREMS)
    assert len(shown) >= 12
    assert sum(path.stat().st_size for path in FILES) < 200_000


def test_the_notebook_is_jupytext_and_quotes_no_number():
    source = (NOTEBOOKS / "proofs.py").read_text(encoding="utf-8")
    cells = re.split(r"^# %%", source, flags=re.MULTILINE)[1:]
    assert sum(cell.startswith(" [markdown]") for cell in cells) >= 5
    words = "".join(cell for cell in cells if cell.startswith(" [markdown]"))
    assert not re.search(r"\d\.\d", words)  # what is computed is printed, never typed
    assert "format_name: percent" in source


@pytest.mark.slow
def test_the_notebook_writes_them_anew(alone, tmp_path):
    environment = os.environ | {"JAXOBS_CERTIFICATES": str(tmp_path)}
    command = [sys.executable, str(NOTEBOOKS / "proofs.py")]
    result = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=600)
    assert result.returncode == 0, result.stdout + result.stderr
    made = sorted(tmp_path.glob("*.json"))
    assert [path.name for path in made] == [path.name for path in FILES]
    require_accepted(alone, made)
    for path in made:
        assert f"{path}: holds for the stored model and bounds" in result.stdout
