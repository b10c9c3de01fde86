"""`jaxobs init`: a file to start from."""

import json
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from jaxobs.cli import screen


def init(
    name: Annotated[str | None, tyro.conf.Positional] = None,
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None,
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Writes an example of the package to start from: a config, or `plant`, a plant of your own in Python. Without NAME: which
    there are. Exit code 0 if it is written, 2 if there is none of that name or the file is there already.

    Args:
        name: one of the examples; `jaxobs init` lists them.
        out: the file to write; NAME.toml, or my_plant.py, if not given.
        force: write over a file that is there.
        as_json: print JSON on standard output instead.
    """
    from jaxobs.cli.examples import PLANT, command_of, everything
    from jaxobs.cli.reading import unknown

    known = everything()
    if name is None:
        heads = {one: _heading(text) for one, text in known.items()}
        if as_json:
            print(json.dumps(heads, indent=2))
        else:
            screen.print_pairs(screen.console(stderr=False), heads)
        return 0
    if name not in known:
        return screen.complain(str(unknown("NAME", name, list(known))).replace("config.NAME", "init"))
    place = out or Path("my_plant.py" if name == PLANT else f"{name}.toml")
    if place.exists() and not force:
        return screen.complain(f"{place}: is there already. --force writes over it, -o FILE writes another.")
    try:
        place.write_text(known[name], encoding="utf-8")
    except OSError as error:
        return screen.complain(f"{place}: {error}")
    command = f"jaxobs {command_of(name)} {place}"
    if as_json:
        print(json.dumps({"file": str(place), "run": command}, indent=2))
    else:
        Console().print(f"written: {place}\nto run it: {command}", markup=False, highlight=False, soft_wrap=True)
    return 0


def _heading(text: str) -> str:
    """The comment, or the docstring, that it begins with."""
    if text.startswith('"""'):
        return " ".join(text.split('"""')[1].split("\n\n")[0].split()).rstrip(".")
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return " ".join(lines).split(". ")[0].rstrip(".:")
