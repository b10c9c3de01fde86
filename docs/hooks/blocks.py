"""Every Python block of a page runs, those of one page in one namespace, and what a block prints is shown below it.

A block whose first line is the name of a file (`# mystudy.py`) is a program for the reader's own machine, with a test of its
own. What a page printed is kept in build/blocks for this state of the page and of the package, so that CI runs a page once:
the tests and the site share it. `python docs/hooks/blocks.py PAGE` runs one page and prints what it prints.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from notebooks import ROOT, framed, package_state

CACHE = ROOT / "build" / "blocks"
LIMIT = 300  # s for one page
BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.DOTALL | re.MULTILINE)
PROGRAM = re.compile(r"# \w+\.py\b")
INCLUDE = re.compile(r'^--8<-- "(.+)"$', re.MULTILINE)
RUNNER = """
import contextlib, io, json, sys, types
page = sys.modules["page"] = types.ModuleType("page")  # functions of the page can be found by their names
made, printed = vars(page), []
for number, code in enumerate(json.load(sys.stdin)):
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        exec(compile(code, f"block {number + 1}", "exec"), made)
    printed.append(text.getvalue())
json.dump(printed, sys.stdout)
"""


def text_of(page: Path) -> str:
    """The Markdown of a page, with the files that it includes."""
    return INCLUDE.sub(lambda match: (ROOT / match[1]).read_text(encoding="utf-8"), page.read_text(encoding="utf-8"))


def blocks(markdown: str) -> list[str]:
    return [code for code in BLOCK.findall(markdown) if not PROGRAM.match(code)]


def printed(markdown: str) -> list[str]:
    """What each block prints. RuntimeError with the traceback where one fails or warns."""
    codes = blocks(markdown)
    key = hashlib.sha256(json.dumps(codes).encode() + package_state()).hexdigest()[:16]
    target = CACHE / f"{key}.json"
    if not codes:
        return []
    if not target.exists():
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg"}
        command = [sys.executable, "-W", "error", "-c", RUNNER]
        with tempfile.TemporaryDirectory() as folder:  # where a block may write files
            done = subprocess.run(
                command, input=json.dumps(codes), capture_output=True, text=True, timeout=LIMIT, env=environment, cwd=folder
            )
        if done.returncode:
            raise RuntimeError(done.stderr)
        CACHE.mkdir(parents=True, exist_ok=True)
        target.write_text(done.stdout, encoding="utf-8")
    return json.loads(target.read_text(encoding="utf-8"))


def on_page_markdown(markdown: str, page, **_) -> str:
    uri = page.file.src_uri
    if uri.startswith(("gallery/", "api/")) or not blocks(markdown) or os.environ.get("JAXOBS_DOCS_EXECUTE") == "0":
        return markdown
    outputs = iter(printed(markdown))

    def with_output(match: re.Match[str]) -> str:
        text = "" if PROGRAM.match(match[1]) else next(outputs)
        return match[0] + (f"\n{framed(text)}" if text.strip() else "")

    return BLOCK.sub(with_output, markdown)


if __name__ == "__main__":
    for output in printed(text_of(Path(sys.argv[1]))):
        print(output, end="")
