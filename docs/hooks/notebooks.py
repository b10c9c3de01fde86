"""The gallery: notebooks/*.py (jupytext, percent form) as pages with the output of their cells.

A notebook is executed once for each state of its source and of the package; the executed form is kept in build/notebooks.
tests/test_docs.py executes them all, so that in CI the site finds what the tests have made. For a quick look at the other pages
JAXOBS_DOCS_EXECUTE=pages leaves out notebooks that are not executed yet, JAXOBS_DOCS_EXECUTE=0 the output of the pages as well.
"""

import base64
import functools
import hashlib
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
CACHE = ROOT / "build" / "notebooks"
LIMIT = 1200  # s for one notebook
ORDER = ["first_observer", "papers", "noise", "proofs", "tuning", "walk", "own_plant", "million_lanes"]
NOQA = re.compile(r"  # noqa: [A-Z0-9, ]+$", re.MULTILINE)
COLUMNS = re.compile(r"\S {2,}\S|[─│━┃]")
COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def sources() -> list[Path]:
    """The notebooks in the order of the gallery; those that it does not name come last."""
    paths = (ROOT / "notebooks").glob("*.py")
    return sorted(paths, key=lambda path: (ORDER.index(path.stem) if path.stem in ORDER else len(ORDER), path.stem))


@functools.cache
def package_state() -> bytes:
    files = sorted(path for path in (ROOT / "jaxobs").rglob("*") if path.suffix in {".py", ".toml", ".csv"})
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).digest()


def kept(path: Path) -> Path:
    """Where the executed form of a notebook is, or will be."""
    key = hashlib.sha256(path.read_bytes() + package_state()).hexdigest()[:16]
    return CACHE / f"{path.stem}-{key}.ipynb"


def execute(path: Path, target: Path) -> None:
    """Run the cells one after the other in a kernel of this Python; CellExecutionError names the cell that fails."""
    import jupytext
    import nbformat
    from nbclient import NotebookClient

    notebook = jupytext.read(path)
    with tempfile.TemporaryDirectory() as folder:  # what a notebook writes is no part of the tree
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=LIMIT, kernel_name="python3", resources=resources).execute()
    CACHE.mkdir(parents=True, exist_ok=True)
    for old in CACHE.glob(f"{path.stem}-*.ipynb"):
        old.unlink()
    nbformat.write(notebook, target)


def executed(path: Path) -> Path:
    """The executed form, made now if there is none, in a process of its own. RuntimeError with the traceback of a cell."""
    target = kept(path)
    if not target.exists():
        command = [sys.executable, __file__, str(path), str(target)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=2 * LIMIT)
        if done.returncode:
            raise RuntimeError(f"{path.name}: {done.stderr[-4000:]}")
    return target


def title(path: Path) -> str:
    """The first heading."""
    return re.search(r"^# # (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1]


def fenced(text: str, language: str = "text") -> str:
    longest = max((len(run) for run in re.findall(r"`{3,}", text)), default=2)
    fence = "`" * (longest + 1)
    return f"{fence}{language}\n{text.rstrip()}\n{fence}\n"


def framed(text: str) -> str:
    """What a block printed: tables keep their lines, sentences may be wrapped."""
    kind = "output table" if COLUMNS.search(text) else "output"
    return f'<div class="{kind}" markdown>\n\n{fenced(text)}\n</div>\n'


def printed(outputs: list) -> list:
    """The outputs of a cell, what goes to one stream joined."""
    joined = []
    for one in outputs:
        if joined and one["output_type"] == joined[-1]["output_type"] == "stream" and one["name"] == joined[-1]["name"]:
            joined[-1] = {**joined[-1], "text": joined[-1]["text"] + one["text"]}
        else:
            joined.append(one)
    return joined


def shown(output, name: str, pictures: dict[str, bytes]) -> str:
    """One output of a cell as Markdown; a picture is put aside under its name."""
    if output["output_type"] == "stream":
        return framed(COLOUR.sub("", output["text"])) if output["name"] == "stdout" else ""
    data = output.get("data", {})
    if "image/png" in data:
        pictures[name] = base64.b64decode(data["image/png"])
        return f"![Output of the cell above]({name.rsplit('/', 1)[-1]})\n"
    if "text/markdown" in data:
        return data["text/markdown"] + "\n"
    if "<table" in (made := data.get("text/html", "")) and "xr-" not in made:  # a frame of pandas; data sets are text
        return '<div class="output table">' + re.sub(r"\n\s*\n", "\n", made) + "</div>\n"
    return framed(COLOUR.sub("", data["text/plain"])) if "text/plain" in data else ""


def rendered(path: Path) -> tuple[str, dict[str, bytes]]:
    """(Markdown, pictures) of a notebook, with outputs if it is executed."""
    import jupytext

    run = os.environ.get("JAXOBS_DOCS_EXECUTE", "1") == "1"
    notebook = jupytext.read(executed(path) if run or kept(path).exists() else path)
    parts, pictures = [], {}
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            parts.append(cell.source + "\n")
            continue
        parts.append(fenced(NOQA.sub("", cell.source), "python"))
        for place, output in enumerate(printed(cell.get("outputs", []))):
            parts.append(shown(output, f"gallery/{path.stem}_{number}_{place}.png", pictures))
    origin = f"*This page is `notebooks/{path.name}`; the outputs are those of the run that built this site.*\n"
    head, *rest = parts
    return "\n".join([head, origin, *rest]), pictures


def on_config(config):
    for section in config.nav:
        if "Gallery" in section:
            section["Gallery"] = ["gallery/index.md", *(f"gallery/{path.stem}.md" for path in sources())]
    return config


def on_files(files, config):
    rows = []
    for path in sources():
        text, pictures = rendered(path)
        files.append(File.generated(config, f"gallery/{path.stem}.md", content=text))
        for name, content in pictures.items():
            files.append(File.generated(config, name, content=content))
        rows.append(f"1. [{title(path)}]({path.stem}.md)")
    index = (ROOT / "docs" / "gallery" / "index.md").read_text(encoding="utf-8").replace("<!-- notebooks -->", "\n".join(rows))
    files.remove(files.get_file_from_path("gallery/index.md"))
    files.append(File.generated(config, "gallery/index.md", content=index))
    return files


if __name__ == "__main__":
    execute(Path(sys.argv[1]), Path(sys.argv[2]))
