"""Lines as text: what C and NumPy share. A number that is used once stands where it is used."""

import abc
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxobs.export.lines import Assign, Cell, Line, Loop, Operand, Ref, read

WIDTH = 88  # of an expression that is put into another one


class AbstractLanguage(abc.ABC):
    """How a language writes numbers, operations and loops; `{0}` in a pattern stands for the first operand."""

    tab: str = "    "

    @abc.abstractmethod
    def number(self, value: Any) -> str:
        """A literal of exactly this value and type."""

    @abc.abstractmethod
    def pattern(self, line: Assign) -> tuple[str, bool]:
        """The text of an operation, and whether it needs parentheses inside another one."""

    @abc.abstractmethod
    def define(self, name: str, dtype: np.dtype, text: str) -> str:
        """A line that gives a number its name."""

    @abc.abstractmethod
    def loop(
        self, loop: Loop, names: Sequence[str], starts: Sequence[str], body: Sequence[str], aheads: Sequence[str]
    ) -> list[str]:
        """A loop's lines, of what `names` carry around; `body` is written already."""


class Text:
    """The text of lines in one language. places: how each entry of what is given is written, by its name."""

    def __init__(
        self, language: AbstractLanguage, lines: tuple[Line, ...], results: Iterable[Operand], places: Mapping[str, list[str]]
    ):
        self.language, self.places = language, places
        self.uses = Counter(one.number for one in read(lines, results) if isinstance(one, Ref))
        self.inline: dict[int, tuple[str, bool]] = {}
        self.names: dict[int, str] = {}
        self.body = self._block(lines)

    def operand(self, one: Operand, inside: bool = False) -> str:
        """As it stands in an expression, or alone."""
        if isinstance(one, Cell):
            return self.places[one.of][one.number]
        if isinstance(one, np.generic):
            return self.language.number(one)
        text, compound = self.inline.get(one.number) or (self._name(one.number), False)
        return f"({text})" if compound and inside else text

    def _name(self, index: int) -> str:
        return self.names.setdefault(index, f"a{len(self.names)}")

    def _block(self, lines: tuple[Line, ...]) -> list[str]:
        language, text = self.language, []
        here = Counter(one.number for one in _direct(lines) if isinstance(one, Ref))
        for line in lines:
            if isinstance(line, Loop):
                starts = [self.operand(one.start) for one in line.carried]
                names = [self._name(one.target) for one in line.carried]
                body = self._block(line.body)
                text += language.loop(line, names, starts, body, [self.operand(one.ahead) for one in line.carried])
                continue
            pattern, compound = language.pattern(line)
            call = pattern.endswith(")") and not compound
            written = pattern.format(*(self.operand(one, inside=not call) for one in line.operands))
            if self.uses[line.target] == 1 and here[line.target] == 1 and len(written) <= WIDTH:
                self.inline[line.target] = (written, compound)
            else:
                text.append(language.define(self._name(line.target), line.dtype, written))
        return text


def _direct(lines: tuple[Line, ...]) -> Iterable[Operand]:
    """What the assignments of a block read themselves."""
    for line in lines:
        if isinstance(line, Assign):
            yield from line.operands
