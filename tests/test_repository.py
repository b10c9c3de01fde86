"""What the repository may hold and what the wheel must hold."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent

FORBIDDEN = {
    "registry address": re.compile(r"https?://\S+(?:/simple\b|\.whl|\.tar\.gz|\.tgz)|--(?:extra-)?index-url\b"),
    "absolute path of a machine": re.compile(r"(?<![\w./-])/(?:root|home|work|Users)/"),
}
PIN = re.compile(r"(?P<name>[a-z0-9.-]+)==(?P<version>[a-z0-9.]+) \\")
HASH = re.compile(r"    --hash=sha256:[0-9a-f]{64}(?: \\)?")


def forbidden(text: str) -> list[str]:
    return [what for what, pattern in FORBIDDEN.items() if pattern.search(text)]


def lock() -> list[str]:
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    return [line for line in lines if line and not re.fullmatch(r"# [\w :]+", line)]


@pytest.mark.skipif(not (ROOT / ".git").exists() or not shutil.which("git"), reason="not a git checkout")
def test_no_file_holds_an_address_or_a_machine_path():
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    paths = [path for name in listed if name and (path := ROOT / name).is_file()]
    assert paths
    found = {str(path): what for path in paths if (what := forbidden(path.read_text(errors="ignore")))}
    assert not found


@pytest.mark.parametrize(
    "text",
    ["https://" + "host.example/simple/", "--" + "index-url x", "open('" + "/ro" + "ot/x')", "cd " + "/ho" + "me/me"],
)
def test_forbidden_text_is_detected(text: str):
    assert len(forbidden(text)) == 1


def test_lock_holds_only_names_versions_and_hashes():
    odd = [line for line in lock() if not PIN.fullmatch(line) and not HASH.fullmatch(line)]
    assert not odd
    assert not [line for line in lock() if re.match("torch|nvidia|jax-cuda", line)]


def test_lock_answers_pyproject():
    pins = {m["name"]: m["version"] for line in lock() if (m := PIN.fullmatch(line))}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [Requirement(r) for r in project["dependencies"] + project["optional-dependencies"]["dev"]]
    stale = [str(r) for r in wanted if r.name not in pins or pins[r.name] not in r.specifier]
    assert not stale, "run make lock"
    assert pins["jax"] == pins["jaxlib"]


def test_wheel_holds_types_data_and_licences(tmp_path: Path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    info = wheel.name.removesuffix("-py3-none-any.whl") + ".dist-info"
    assert {
        "jaxobs/py.typed",
        "jaxobs/datasets/shank_walk.csv",
        "jaxobs/datasets/LICENSE-scikit-kinematics.txt",
        f"{info}/licenses/LICENSE",
        f"{info}/licenses/jaxobs/datasets/LICENSE-scikit-kinematics.txt",
    } <= names
