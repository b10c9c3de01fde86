"""A plant of the user's own, from a Python file: my_plant.py:MyPlant, a class or an object."""

import functools
import re
import sys
import traceback
import types
from pathlib import Path
from typing import Any

from jaxobs._module import refuse
from jaxobs.cli.reading import unknown
from jaxobs.plants import AbstractPlant

PATTERN = re.compile(r"(?P<file>.+\.py)(?::(?P<name>\w+))?")


def is_own(name: Any) -> bool:
    """Whether this names a file rather than a plant of the package."""
    return isinstance(name, str) and PATTERN.fullmatch(name) is not None


def load(spec: str, where: str = "plant") -> Any:
    """The plant class, or the plant, that `spec` names: FILE.py:NAME, or FILE.py if it has one alone.

    The file runs as the module of its name, as `import` would run it from its folder. ValueError names the key `where` if there
    is no such file, if it does not run, or if it has no such plant.
    """
    found = PATTERN.fullmatch(spec)
    if found is None:
        raise refuse("config", where, repr(spec), "FILE.py:NAME", "For example my_plant.py:MyPlant.")
    path = Path(found["file"]).expanduser()
    if not path.is_file():
        raise refuse("config", where, repr(spec), "a file that exists", "`jaxobs init plant` writes one to start from.")
    module = _run(path, spec, where)
    known = {name: one for name, one in vars(module).items() if _is_plant(one, module)}
    if not known:
        fix = "Subclass one of jaxobs.plants.Abstract..., or call jaxobs.plants.from_function."
        raise refuse("config", where, repr(spec), "a file with a plant in it", fix)
    if found["name"] is None:
        if len(known) > 1:
            fix = f"Write {found['file']}:{next(iter(known))}."
            raise refuse("config", where, repr(spec), f"the name of one of its plants, {', '.join(known)}", fix)
        return next(iter(known.values()))
    if found["name"] not in known:
        raise unknown(where, found["name"], list(known))
    return known[found["name"]]


def _run(path: Path, spec: str, where: str) -> Any:
    name = path.stem
    if not name.isidentifier() or _is_taken(name, path):
        fix = "Rename it: it is imported under its own name, by workers and pickles too."
        raise refuse("config", where, repr(spec), "a file whose name is that of no other module", fix)
    try:
        return _executed(path.resolve(), path.read_bytes())
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [one.lineno for one in frames if Path(one.filename) == path.resolve()]
        line = f" in line {lines[-1]}" if lines else ""
        said = f"{type(error).__name__}{line}: {error}"
        raise refuse("config", where, repr(spec), "a file that runs", said) from error


@functools.lru_cache
def _executed(path: Path, source: bytes) -> types.ModuleType:
    """The module that this source makes: run once, so that a plant and the model that is made like it are of one class."""
    module = types.ModuleType(path.stem)
    module.__file__ = str(path)
    before = sys.modules.get(path.stem)
    sys.modules[path.stem] = module
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # its own imports, and unpickling
    try:
        exec(compile(source, path, "exec"), module.__dict__)  # not through the import system: a .pyc could be older by an edit
    except BaseException:
        if before is None:
            del sys.modules[path.stem]
        else:
            sys.modules[path.stem] = before
        raise
    return module


def _is_taken(name: str, path: Path) -> bool:
    """Whether another module has this name already, or would be hidden by it."""
    there = sys.modules.get(name)
    if there is not None:
        return Path(getattr(there, "__file__", None) or "").resolve() != path.resolve()
    return name in sys.stdlib_module_names


def _is_plant(one: Any, module: Any) -> bool:
    """A plant, or a plant class that the file itself defines and that is not abstract."""
    if isinstance(one, type):
        return issubclass(one, AbstractPlant) and one.__module__ == module.__name__ and not one.__name__.startswith("Abstract")
    return isinstance(one, AbstractPlant)


def beside(tables: dict[str, Any], config: Path) -> dict[str, Any]:
    """The tables, where a plant's file that is not found from here is looked for beside the config."""
    plant = tables.get("plant")
    found = PATTERN.fullmatch(str(plant.get("name"))) if isinstance(plant, dict) else None
    if not isinstance(plant, dict) or found is None or Path(found["file"]).is_file():
        return tables
    place = config.parent / plant["name"]
    return tables | {"plant": plant | {"name": str(place)}} if (config.parent / found["file"]).is_file() else tables
