"""How an equinox Module is called: its fields, those of its bases first, as `__init__` would have them.

Griffe reads source and knows dataclasses by their decorator; a Module is one by its base.
"""

import ast
from collections.abc import Iterator

import griffe

ROOT = "jaxobs._module.Module"
REQUIRED = griffe.ParameterKind.positional_or_keyword


def classes(within: griffe.Module | griffe.Class) -> Iterator[griffe.Class]:
    for member in within.members.values():
        if member.is_alias:
            continue
        if member.is_class:
            yield member
        if member.is_module or member.is_class:
            yield from classes(member)


def lineage(cls: griffe.Class) -> list[griffe.Class]:
    """The class and its bases within the package, the most basic first; [] if it is no Module."""
    try:
        bases = [base for base in cls.mro() if base.path.startswith("jaxobs.")]
    except ValueError:
        return []
    return [*reversed(bases), cls] if any(base.path == ROOT for base in bases) else []


def default_of(value: str | None) -> tuple[bool, str | None]:
    """(whether it has one, what it is) from `param(default=1.0)`, `static()`, a plain value or nothing."""
    if value is None:
        return False, None
    call = ast.parse(value, mode="eval").body
    if isinstance(call, ast.Call) and ast.unparse(call.func) in {"param", "static", "eqx.field"}:
        given = [ast.unparse(one.value) for one in call.keywords if one.arg in {"default", "default_factory"}]
        return bool(given), given[0] if given else None
    return True, value


def parameters(chain: list[griffe.Class]) -> list[griffe.Parameter]:
    found = {}
    for one in chain:
        for name, member in one.members.items():
            if member.is_alias or not member.is_attribute or name.startswith("_"):
                continue
            found.pop(name, None)  # a base's field that is a class attribute or a property here
            if member.annotation is None or "property" in member.labels:
                continue
            if not any(word in str(member.annotation) for word in ("ClassVar", "AbstractVar", "AbstractClassVar")):
                has, default = default_of(None if member.value is None else str(member.value))
                found[name] = griffe.Parameter(
                    name, annotation=member.annotation, kind=REQUIRED, default=default if has else None
                )
    return list(found.values())


class Signatures(griffe.Extension):
    """Gives every Module of the package the `__init__` that equinox makes of its fields."""

    def on_package(self, *, pkg: griffe.Module, **_) -> None:
        for cls in classes(pkg):
            if cls.name.startswith("Abstract"):
                continue
            if "__init__" not in cls.members and (chain := lineage(cls)):
                own = griffe.Parameter("self", annotation=None, kind=REQUIRED, default=None)
                made = griffe.Function("__init__", parameters=griffe.Parameters(own, *parameters(chain)), parent=cls)
                cls.set_member("__init__", made)
