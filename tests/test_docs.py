"""The documentation: every block runs, every command parses, every public name is there, and the site builds without a warning.

The pages, the notebooks and the site share what they execute (docs/hooks keeps it in build/), so that CI executes each once.
"""

import functools
import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import jaxobs

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "hooks"))
import blocks  # noqa: E402
import mathematics  # noqa: E402
import pages  # noqa: E402

import notebooks  # noqa: E402

PAGES = sorted(path for path in DOCS.rglob("*.md") if blocks.blocks(blocks.text_of(path)))
FAST = {"certificates.md"}  # in `make test`; the others are slow
SAYS = {
    "first_observer": "exact arithmetic",
    "million_lanes": "equal to the last bit: True",
    "own_plant": "proved",
    "tuning": "proved in exact arithmetic",
}  # what a notebook has to print
README = ROOT / "README.md"
COMMANDS = [README, *DOCS.rglob("*.md")]


def names(paths):
    return [str(path.relative_to(ROOT)) for path in paths]


def run(page):
    printed = blocks.printed(blocks.text_of(page))
    assert len(printed) == len(blocks.blocks(blocks.text_of(page)))
    return printed


@pytest.mark.parametrize("page", [page for page in PAGES if page.name in FAST], ids=lambda page: page.stem)
def test_blocks_of_a_page_run(page):
    assert "exact arithmetic" in "".join(run(page))


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if page.name not in FAST], ids=lambda page: page.stem)
def test_blocks_of_every_page_run(page):
    run(page)


def test_a_block_that_fails_or_warns_is_an_error():
    with pytest.raises(RuntimeError, match="block 2"):
        blocks.printed("```python\nx = 1\n```\n\n```python\ny = x / 0\n```\n")
    with pytest.raises(RuntimeError, match="UserWarning: loud"):
        blocks.printed("```python\nimport warnings\nwarnings.warn('loud')\n```\n")


def test_programs_of_a_page_have_a_test_of_their_own():
    """Blocks that name a file are left out above: only the page on studies has any, and test_study_page runs them."""
    programs = {path.name for path in DOCS.rglob("*.md") if blocks.BLOCK.findall(blocks.text_of(path)) and path not in PAGES}
    mixed = {path.name for path in PAGES if len(blocks.BLOCK.findall(text := blocks.text_of(path))) != len(blocks.blocks(text))}
    assert programs | mixed == {"studies.md"}
    assert (ROOT / "tests" / "test_study_page.py").exists()


def commands(path):
    """The jaxobs commands in the bash blocks of a page, and those named in its text by `jaxobs NAME ...`."""
    text = path.read_text(encoding="utf-8")
    for block in re.findall(r"```bash\n(.*?)```", text, flags=re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            if words := re.search(r"(?:^|exec )(jaxobs .*)", line):
                yield shlex.split(words[1], comments=True)[1:]


def test_commands_of_the_pages_parse(monkeypatch, capsys):
    """Every command of a bash block is accepted by the command line, which is not carried out."""
    from jaxobs import cli

    def parsed(command):
        @functools.wraps(command)
        def accept(*args, **options):
            return "accepted"

        return accept

    monkeypatch.setattr(cli, "COMMANDS", {name: (parsed(one), words) for name, (one, words) in cli.COMMANDS.items()})
    found = [words for path in COMMANDS for words in commands(path)]
    assert len(found) >= 4
    for words in found:
        given = [
            word.replace("$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT", "17/100").replace("$STORE", "s") for word in words
        ]
        if "--help" in given:
            assert given[0] in cli.COMMANDS
        else:
            assert cli._run(given) == "accepted", given
    with pytest.raises(SystemExit):
        cli._run(["certify", "pendulum", "--no-such-option"])


def test_commands_named_in_the_text_exist():
    from jaxobs import cli

    named = {name for path in COMMANDS for name in re.findall(r"`jaxobs (\w+)", path.read_text(encoding="utf-8"))}
    assert named
    assert named - {"COMMAND"} <= set(cli.COMMANDS)


def test_the_reference_has_every_public_name():
    """What a namespace has at run time is on its page, unless it is a module or private."""
    listed = pages.namespaces()
    assert {"jaxobs", "designs", "observers", "certificates", "tuning.objectives"} <= set(listed)
    assert set(jaxobs._NAMES) <= set(listed["jaxobs"])
    assert set(jaxobs._MODULES) <= set(listed)
    for folder in ("observers", "plants", "signals"):
        run_time = vars(importlib.import_module(f"jaxobs.{folder}"))
        public = {name for name, value in run_time.items() if not name.startswith("_") and not isinstance(value, ModuleType)}
        assert public == set(listed[folder]), folder


@pytest.mark.parametrize(
    "target", ["0.5", r"\lambda_{\min}(P) |x| = -e", r"\begin{bmatrix} a & b \\ c & d \end{bmatrix} \succ 0"]
)
def test_formulas_become_mathml(target):
    made = mathematics.on_page_content(f'<p><span class="arithmatex">\\({target}\\)</span></p>')
    assert made.startswith('<p><span class="formula"><math')
    assert "arithmatex" not in made


def test_names_of_the_reference_are_those_of_the_text():
    """Links into the reference, [..](../api/designs.md#jaxobs.designs.riccati), are to public names."""
    listed = pages.namespaces()
    for path in DOCS.rglob("*.md"):
        for page, anchor in re.findall(r"api/([\w.]+)\.md#(jaxobs[\w.]*)", path.read_text(encoding="utf-8")):
            prefix = "jaxobs" if page == "jaxobs" else f"jaxobs.{page}"
            assert anchor.removeprefix(f"{prefix}.") in listed[page], f"{path.name}: {anchor}"


@pytest.mark.slow
@pytest.mark.parametrize("path", notebooks.sources(), ids=lambda path: path.stem)
def test_notebooks_execute(path):
    text, _ = notebooks.rendered(path)
    assert SAYS.get(path.stem, "") in text
    assert text.startswith("# ")
    assert '<div class="output"' in text


@pytest.mark.slow
def test_the_site_builds_without_warnings_and_needs_no_network(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=quiet, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    made = [path for path in (tmp_path / "site").rglob("*") if path.suffix in {".html", ".css"}]
    assert len(made) > 40
    for page in made:
        text = page.read_text(encoding="utf-8")
        fetched = re.findall(r"<(?:script|link|img|iframe)[^>]+(?:src|href)=\"?(https?://[^\"> ]+)", text)
        fetched += re.findall(r"(?:@import|url\()[\s\"']*(https?://[^\"') ]+)", text)
        assert not fetched, f"{page.name} fetches {fetched}"
        assert 'class="arithmatex"' not in text
    assert "<math" in (tmp_path / "site" / "mathematics" / "lmi.html").read_text(encoding="utf-8")
