"""Pages that are written by the package itself: the reference of every namespace, and the help texts of the command line.

A public name is one that a folder's `__init__.py` re-exports (`from ... import name as name`), or a function, class or constant
with a docstring of a single-file namespace. So a new name is in the reference as soon as it is public.
"""

import ast
import os
import subprocess
import sys
from pathlib import Path

from mkdocs.structure.files import File

PACKAGE = Path(__file__).parents[2] / "jaxobs"
HIDDEN = {"cli", "bench", "demo", "configs"}  # reached through the command line
HELP = """
import contextlib, io
from jaxobs import cli
for name in ("", *cli.COMMANDS):
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        import sys
        sys.argv = ["jaxobs", *([name] if name else []), "--help"]
        cli.main()
    print(f"\\0{name}\\0{text.getvalue()}", end="")
"""


def reexported(init: Path) -> dict[str, str]:
    """{public name: where it is defined} of a folder: what it imports as itself, and what it defines; not its modules."""
    folder = ".".join(("jaxobs", *init.parent.relative_to(PACKAGE).parts))
    names = {name: f"{folder}.{name}" for name in defined(init)}
    for node in ast.walk(ast.parse(init.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.module != folder:
            public = [one.name for one in node.names if one.asname == one.name and not one.name.startswith("_")]
            names |= {name: f"{node.module}.{name}" for name in public}
    return dict(sorted(names.items(), key=lambda item: (item[0].lower(), item[0])))


def defined(module: Path) -> list[str]:
    """The public functions and classes that a file defines, in its order."""
    kinds = ast.FunctionDef | ast.ClassDef
    body = ast.parse(module.read_text(encoding="utf-8")).body
    return [node.name for node in body if isinstance(node, kinds) and not node.name.startswith("_")]


def namespaces() -> dict[str, dict[str, str]]:
    """{namespace: {public name: where it is defined}}; "jaxobs" holds the names that are reached from the top."""
    found = {}
    for path in sorted((*PACKAGE.iterdir(), PACKAGE / "tuning" / "objectives")):
        name = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        if name.startswith("_") or name in HIDDEN:
            continue
        if path.suffix == ".py":
            found[name] = {one: f"jaxobs.{name}.{one}" for one in defined(path)}
        elif (init := path / "__init__.py").exists() and (names := reexported(init)):
            found[name] = names
    return {"jaxobs": reexported(PACKAGE / "__init__.py")} | found


def reference(name: str, names: dict[str, str]) -> str:
    """The page of a namespace. A function whose file has its name (designs/riccati.py) is asked for where it is defined."""
    path = "jaxobs" if name == "jaxobs" else f"jaxobs.{name}"
    lines = [f"# {path}", "", f"::: {path}", "    options:", "      members: []", "      show_root_heading: false",
             "      show_root_toc_entry: false", ""]  # fmt: skip
    folder = PACKAGE.joinpath(*path.split(".")[1:])
    for one, origin in names.items():
        if (folder / f"{one}.py").exists() or (folder / one).is_dir():
            lines += [f'<a id="{path}.{one}"></a>', "", f"::: {origin}", ""]
        else:
            lines += [f"::: {path}.{one}", ""]
    return "\n".join(lines)


def on_config(config):
    api = [{f"jaxobs.{name}" if name != "jaxobs" else name: f"api/{name}.md"} for name in namespaces()]
    for section in config.nav:
        if "API" in section:
            section["API"] = ["api/index.md", *api]
    return config


def on_files(files, config):
    found = namespaces()
    for name, names in found.items():
        files.append(File.generated(config, f"api/{name}.md", content=reference(name, names)))
    return files


def on_page_markdown(markdown: str, page, **_) -> str:
    if page.file.src_uri == "api/index.md":
        rows = [f"| [{name}]({name}.md) | {', '.join(f'`{one}`' for one in names)} |" for name, names in namespaces().items()]
        return markdown.replace("<!-- namespaces -->", "\n".join(["| namespace | public names |", "|---|---|", *rows]))
    if page.file.src_uri == "command_line.md":
        return markdown.replace("<!-- commands -->", commands())
    return markdown


def commands() -> str:
    """What `jaxobs --help` and `jaxobs COMMAND --help` print, each under a heading."""
    plain = os.environ | {"COLUMNS": "76", "NO_COLOR": "1", "TERM": "dumb"}
    made = subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True, env=plain, check=True)
    parts = made.stdout.split("\0")[1:]
    sections = []
    for name, text in zip(parts[::2], parts[1::2], strict=True):
        command = f"jaxobs {name}".strip()
        body = "\n".join(line.rstrip() for line in text.splitlines())
        sections.append(f"## `{command}` {{#{name or 'jaxobs'}}}\n\n```text\n{body}\n```\n")
    return "\n".join(sections)
