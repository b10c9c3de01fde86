"""The layers of the package, read from its source: imports are parsed, never executed."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "jaxobs"

# Register a new top-level module or folder here, as (layer, place within the layer): imports point to lower or equal
# pairs. Other top-level modules named with a leading underscore are helpers of layer 0.
RANK = {
    **dict.fromkeys(["chain_bounds", "errors", "linalg", "hurwitz", "intervals", "scalars"], (0, 0)),
    **dict.fromkeys(["signals", "noise", "integrators"], (1, 0)),
    "plants": (1, 1),
    "observers": (2, 0),
    **dict.fromkeys(["_loop", "_motion", "_observe", "_simulate", "_differentiate", "metrics"], (3, 0)),
    **dict.fromkeys(["certificates", "excitation", "datasets", "monitors", "structure"], (3, 0)),
    "designs": (4, 0),
    "interop": (4, 0),
    "export": (4, 1),
    "streaming": (4, 2),
    "studies": (4, 1),
    "tuning": (4, 2),
    "papers": (4, 3),
    "demo": (4, 4),
    "bench": (4, 4),
    **dict.fromkeys(["cli", "configs", "report", "plotting", "__main__"], (5, 0)),
    "": (5, 0),  # jaxobs/__init__.py names every layer, so only the last one may import it
}

# Third-party packages that belong to some of the above.
SCREEN = {"cli", "report", "plotting", "__main__"}
OWNERS = {
    "clarabel": {"designs"},
    "cvxpy": {"designs"},
    "diffrax": {"integrators"},
    "flint": {"intervals"},
    "control": {"interop"},
    "pandas": {"cli"},
    "xarray": {"studies", "interop"},
    "zarr": {"studies"},
    "cloudpickle": {"studies"},
    "distributed": {"studies"},
    "optax": {"tuning", "papers", "report"},
    "matplotlib": {"plotting", "report"},
    "plotly": {"plotting", "report"},
    "tyro": SCREEN,
    "rich": SCREEN | {"studies"},
}

ROOTS = {"Module"}  # the one concrete base of everything, jaxobs/_module.py


def read_package() -> dict[str, str]:
    return {str(path.relative_to(PACKAGE)): path.read_text() for path in sorted(PACKAGE.rglob("*.py"))}


def module_name(path: str) -> str:
    parts = Path(path).with_suffix("").parts
    return ".".join(("jaxobs", *parts[:-1], *[p for p in parts[-1:] if p != "__init__"]))


def top_level(module: str) -> str:
    return f"{module}.".split(".")[1]


def rank(top: str) -> tuple[int, int] | None:
    return RANK.get(top, (0, 0) if top.startswith("_") else None)


def imported(path: str, source: str, modules: set[str]) -> Iterator[str]:
    """Dotted names of the modules that one file imports, wherever in the file the statement stands."""
    package = ("jaxobs", *Path(path).parent.parts)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else ()
            base = ".".join([*above, *filter(None, [node.module])])
            names = [f"{base}.{alias.name}" for alias in node.names]
            yield from (name if name in modules else base for name in names)


def violations(files: dict[str, str]) -> list[str]:
    """What in a package {path: source} breaks the layers; empty when nothing does."""
    modules = {module_name(path) for path in files}
    found, graph = [], {}
    for path, source in files.items():
        module = module_name(path)
        top, targets = top_level(module), set(imported(path, source, modules))
        if rank(top) is None:
            found.append(f"{path}: unknown top-level name {top!r}: register it in RANK, tests/test_layers.py")
            continue
        for target in sorted(targets):
            if target.split(".")[0] != "jaxobs":
                owners = OWNERS.get(target.split(".")[0])
                if owners and top not in owners:
                    found.append(f"{path}: imports {target}, which belongs to {', '.join(sorted(owners))}")
                continue
            limit = (0, 0) if top == "datasets" else rank(top)
            reached = rank(top_level(target))
            if top_level(target) != top and (reached is None or reached > limit):
                found.append(f"{path}: imports {target}, which is not below it")
        graph[module] = {t for t in targets if t in modules} - {"jaxobs"}
    try:
        TopologicalSorter({m: graph[m] for m in graph if m != "jaxobs"}).prepare()
    except CycleError as error:
        found.append(f"import cycle: {' <- '.join(error.args[1])}")
    return found


def subclassed_concrete(files: dict[str, str]) -> list[str]:
    """Classes of the package that have a subclass in it and are neither Abstract... nor a root nor exceptions."""
    classes = [n for s in files.values() for n in ast.walk(ast.parse(s)) if isinstance(n, ast.ClassDef)]
    names = {c.name for c in classes}
    bases = [b.value if isinstance(b, ast.Subscript) else b for c in classes for b in c.bases]
    used = {ast.unparse(b).split(".")[-1] for b in bases}
    bad = (names & used) - ROOTS
    return sorted(n for n in bad if not n.lstrip("_").startswith("Abstract") and not n.endswith("Error"))


def test_imports_point_to_lower_layers():
    assert not (found := violations(read_package())), "\n".join(found)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"observers/a.py": "from jaxobs.designs import b", "designs/b.py": ""}, "not below"),
        ({"observers/a.py": "from ..designs.b import c"}, "not below"),
        ({"noise/a.py": "def f():\n    import jaxobs.plants"}, "not below"),
        ({"designs/a.py": "import jaxobs"}, "not below"),
        ({"datasets/__init__.py": "from jaxobs.plants import x"}, "not below"),
        ({"_simulate.py": "import cvxpy as cp"}, "cvxpy, which belongs to designs"),
        ({"papers/a.py": "from matplotlib.figure import Figure"}, "belongs to"),
        ({"plants/a.py": "from . import b", "plants/b.py": "from jaxobs.plants.a import x"}, "import cycle"),
        ({"plants/__init__.py": "from .a import x", "plants/a.py": "from jaxobs.plants import y"}, "import cycle"),
        ({"helpers.py": ""}, "unknown top-level name 'helpers'"),
    ],
)
def test_violation_is_detected(files: dict[str, str], message: str):
    found = violations(files)
    assert len(found) == 1
    assert message in found[0]


def test_classes_are_abstract_or_final():
    assert subclassed_concrete({"a.py": "class A: ...", "b.py": "class B(a.A[int]): ..."}) == ["A"]
    assert subclassed_concrete(read_package()) == []


def test_files_are_short_and_public_modules_say_what_they_are():
    files = read_package()
    assert files, "no source found"
    too_long = [path for path, source in files.items() if len(source.splitlines()) > 300]
    assert not too_long, f"over 300 lines: {too_long}"
    public = {path: s for path, s in files.items() if not any(p.startswith("_") for p in module_name(path).split("."))}
    silent = [path for path, source in public.items() if not ast.get_docstring(ast.parse(source))]
    assert not silent, f"no module docstring: {silent}"
