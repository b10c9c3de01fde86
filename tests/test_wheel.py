"""What a release says about itself: version, citation, and the lower bounds that `make wheel` installs."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version

import jaxobs

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PIN = re.compile(r"(?P<name>[a-z0-9.-]+)==(?P<version>[a-z0-9.]+)(?: ; [\w .'<>=!]+)? \\")


def lowest():
    lines = (ROOT / "requirements-lowest.txt").read_text().splitlines()
    return lines, {m["name"]: Version(m["version"]) for line in lines if (m := PIN.fullmatch(line))}


def test_the_version_is_semantic_and_the_changelog_knows_it():
    assert re.fullmatch(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)(-[0-9A-Za-z.-]+)?", jaxobs.__version__)
    log = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[{re.escape(jaxobs.__version__)}\]", log, re.MULTILINE) or f"Towards {jaxobs.__version__}" in log


def test_the_citation_file_is_valid_and_of_this_version():
    """The keys that version 1.2.0 of the format requires, and the ones used here by its schema."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(cited)
    assert set(cited) <= {
        "cff-version",
        "message",
        "type",
        "title",
        "authors",
        "version",
        "license",
        "keywords",
        "date-released",
    }
    assert cited["cff-version"] == "1.2.0"
    assert cited["version"] == jaxobs.__version__
    assert cited["license"] == PROJECT["license"]
    assert all(set(author) == {"name"} for author in cited["authors"])


def test_the_lowest_versions_are_the_lower_bounds():
    """Each direct dependency is pinned at the first release that its bound allows: `make lowest` keeps it so."""
    lines, pins = lowest()
    assert all(PIN.fullmatch(line) or re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}(?: \\)?", line) for line in lines)
    for wanted in map(Requirement, PROJECT["dependencies"]):
        (bound,) = [Version(one.version) for one in wanted.specifier if one.operator == ">="]
        assert pins[wanted.name] in wanted.specifier
        assert pins[wanted.name].release[: len(bound.release)] == bound.release, f"{wanted.name}: run make lowest"


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_the_metadata_name_the_pythons(python):
    assert f"Programming Language :: Python :: {python}" in PROJECT["classifiers"]
    assert Version(python) in SpecifierSet(PROJECT["requires-python"])
