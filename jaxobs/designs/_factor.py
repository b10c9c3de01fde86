"""A Jacobian as constants and few parameters: J(z) = J_0 + sum_g rho_g(z) M_g, in exact arithmetic.

An entry is constant_ij + sum_k v_ijk atom_k(z), its atoms nonlinear terms. Entries whose rows v_ij are parallel share a
parameter (one core, up to constants); so do atoms whose columns v_k are parallel.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

from jaxobs.intervals.expressions import is_float

SMALL = range(1, 17)  # factors that derivatives of powers bring, tried first
Place = tuple[int, int]
Terms = tuple[tuple[int, Fraction], ...]


@dataclasses.dataclass(frozen=True)
class Parameter:
    """rho = sum of coefficient * atom over the terms, which enters J as rho M; M as {(row, column): entry}."""

    terms: Terms
    matrix: dict[Place, Fraction]

    def scaled(self) -> "Parameter":
        """The same rho M, its factor such that all entries of M are floats, if there is one."""
        entries = list(self.matrix.values())
        common = math.lcm(*(entry.denominator for entry in entries))
        divisor = Fraction(math.gcd(*(int(entry * common) for entry in entries)), common)
        trials = [*map(Fraction, SMALL), divisor]
        factor = next((one for one in trials if all(is_float(entry / one) for entry in entries)), entries[0])
        terms = tuple((atom, coefficient * factor) for atom, coefficient in self.terms)
        return Parameter(terms, {place: entry / factor for place, entry in self.matrix.items()})

    def channels(self) -> list[tuple[dict[int, Fraction], dict[int, Fraction]]]:
        """M = sum of b c': one pair if M has rank one and b, c are floats, else one for each row or column, whichever are
        fewer."""
        rows, columns = ({place[axis] for place in self.matrix} for axis in (0, 1))
        first = min(rows)
        row = {j: entry for (i, j), entry in self.matrix.items() if i == first}
        for pivot, divisor in row.items():
            c = {j: entry / divisor for j, entry in row.items()}
            b = {i: entry for (i, j), entry in self.matrix.items() if j == pivot}
            product = {(i, j): x * y for i, x in b.items() for j, y in c.items()}
            if product == self.matrix and all(map(is_float, (*b.values(), *c.values()))):
                return [(b, c)]
        one = Fraction(1)
        if len(columns) <= len(rows):
            return [({i: x for (i, k), x in self.matrix.items() if k == j}, {j: one}) for j in sorted(columns)]
        return [({i: one}, {j: x for (k, j), x in self.matrix.items() if k == i}) for i in sorted(rows)]


def factor(entries: dict[Place, Terms]) -> list[Parameter]:
    """The parameters of a table of nonconstant entries: for each group of entries that share atoms, by entries or by atoms,
    whichever makes fewer parameters, then fewer channels."""
    found = []
    for group in _components(entries):
        table = {place: dict(entries[place]) for place in group}
        ways = [[p.scaled() for p in way] for way in (_by_atoms(table), _by_entries(table))]
        found += min(ways, key=lambda way: (len(way), sum(len(p.channels()) for p in way)))
    return found


def separate(entries: dict[Place, Terms]) -> list[Parameter]:
    """Every entry by itself: what is left of a Jacobian if nothing but bounds on its entries is known."""
    return [Parameter(terms, {place: Fraction(1)}) for place, terms in sorted(entries.items())]


def _by_entries(table: dict[Place, dict[int, Fraction]]) -> list[Parameter]:
    groups: dict[Terms, dict[Place, Fraction]] = {}
    for place, terms in sorted(table.items()):
        core, lead = _normalised(terms)
        groups.setdefault(core, {})[place] = lead
    return [Parameter(core, matrix) for core, matrix in groups.items()]


def _by_atoms(table: dict[Place, dict[int, Fraction]]) -> list[Parameter]:
    columns: dict[int, dict[Place, Fraction]] = {}
    for place, terms in sorted(table.items()):
        for atom, coefficient in terms.items():
            columns.setdefault(atom, {})[place] = coefficient
    groups: dict[Any, list[tuple[int, Fraction]]] = {}
    for atom, column in sorted(columns.items()):
        core, lead = _normalised(column)
        groups.setdefault(core, []).append((atom, lead))
    found = []
    for terms in groups.values():
        (first, size), *_ = terms  # the column of the first atom as it is, so that its entries stay floats
        found.append(Parameter(tuple((atom, lead / size) for atom, lead in terms), columns[first]))
    return found


def _normalised(row: dict[Any, Fraction]) -> tuple[Any, Fraction]:
    """(The row with 1 as its first entry, that entry)."""
    lead = row[min(row)]
    return tuple((key, row[key] / lead) for key in sorted(row)), lead


def _components(entries: dict[Place, Terms]) -> Iterable[Sequence[Place]]:
    """Entries connected by common atoms."""
    groups: list[tuple[set[int], list[Place]]] = []
    for place, terms in sorted(entries.items()):
        atoms, members = {atom for atom, _ in terms}, [place]
        apart = []
        for other, own in groups:
            if atoms & other:
                atoms, members = atoms | other, own + members
            else:
                apart.append((other, own))
        groups = [*apart, (atoms, members)]
    return [members for _, members in groups]
