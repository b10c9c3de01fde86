"""Certificates whose bounds travel with them: the Jacobian of the model as formulas, and a bisection of the box that proves

    df/dx = a + sum_k rho_k b_k c_k',   lower_k <= rho_k <= upper_k

in interval arithmetic that needs nothing but Python (`checker_bounds`): a stranger trusts neither jaxobs nor its bounds.
"""

import dataclasses
import json
from collections.abc import Callable, Sequence
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jaxobs._module import refuse
from jaxobs.certificates import checker_bounds, checker_more
from jaxobs.certificates._bisection import Prover
from jaxobs.certificates.base import AbstractCertificate, Verdict
from jaxobs.intervals import graph
from jaxobs.intervals.formulas import Expression, combine, constant

FORMAT = "jaxobs-bounds/1"
FEW = 100  # bisections before bounds are relaxed


@dataclasses.dataclass(frozen=True)
class Travelling:
    """A certificate and what proves its bounds: `verify()` decides both, `to_json` writes one file for both checkers.

    bounds: the field of that name in the file.
    """

    certificate: AbstractCertificate
    bounds: dict[str, Any]

    @property
    def leaves(self) -> int:
        """In how many boxes the bisections cut the box, over all parameters."""
        return sum(one["splits"].count(0) for one in self.bounds["parameters"])

    def to_dict(self) -> dict[str, Any]:
        """Plain data: the certificate with its bounds, under one hash."""
        body = {key: value for key, value in self.certificate.to_dict().items() if key != "sha256"} | {"bounds": self.bounds}
        return body | {"sha256": checker_more.digest(body)}

    def to_json(self, path: str | PathLike[str]) -> None:
        """One file, which `checker_more` and `checker_bounds` decide, each its part."""
        Path(path).write_text(json.dumps(self.to_dict(), indent=1) + "\n", encoding="utf-8")

    def verify(self) -> Verdict:
        """Decides the certificate, then its bounds, each by the checker that a stranger would run."""
        verdict = self.certificate.verify()
        if not verdict.holds:
            return verdict
        found = checker_bounds.check(self.to_dict())
        return Verdict(found["holds"], verdict.margins, f"{verdict.why}; {found['why']}" if found["holds"] else found["why"])


def with_bounds(
    certificate: Any, f: Callable[..., Any], lower: ArrayLike, upper: ArrayLike, *, relax: float = 0.0, most: int = 2000
) -> Travelling:
    """The certificate of e' = (a + sum_k rho_k b_k c_k' - ...) e together with a proof that these bounds are those of f.

    certificate: with the fields a (n, n), b, c, lower, upper, tied. f(x), x (n,), or f(x, u): its Jacobian along x is
    the matrix of the certificate. lower, upper (n,) or (n + m,): the box of x, and of u, possibly infinite. The bounds have to
    hold on it in plain interval arithmetic after at most `most` bisections for each parameter; relax > 0 widens those not seen
    easily by this fraction of their width, and verifies the certificate again.

    ValueError where a, b, c are not, to the last bit, the constants and coefficients of the Jacobian; where a bound is wrong or
    too tight; where the wider bounds are not certified.
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    n = len(certificate.a)
    if low.ndim != 1 or low.shape != high.shape or len(low) < n or not np.all(low <= high):
        fix = f"One pair for each of the {n} states, then one for each input."
        raise refuse("with_bounds", "lower", f"{low.tolist()} .. {high.tolist()}", "lower <= upper, vectors of one length", fix)
    jacobian = graph.jacobian(f, n, len(low) - n)
    if jacobian.outputs.shape != (n, n):
        given = f"a Jacobian of shape {jacobian.outputs.shape}"
        raise refuse(
            "with_bounds", "f", given, f"shape {(n, n)}", "It maps the states of the certificate to their derivatives."
        )
    if jacobian.jumps:
        fix = "Nothing proves f continuous there, which the mean value theorem needs: write it with min, max, abs or clip."
        raise refuse("with_bounds", "f", f"a switch at {' and '.join(jacobian.jumps)}", "a continuous function", fix)
    rhos = parameters(certificate, jacobian)
    bounds = _file(jacobian, list(rhos.values()), low, high)
    prover, ends = Prover(bounds), [list(certificate.lower), list(certificate.upper)]
    tied = certificate.tied or tuple(range(len(certificate.lower)))
    for one, name in zip(bounds["parameters"], rhos, strict=True):
        k = tied.index(name)
        try:
            one["splits"] = prover.splits(one["rho"], ends[0][k], ends[1][k], k, min(most, FEW) if relax > 0 else most)
        except ValueError:
            if relax <= 0:
                raise
            margin = relax * (ends[1][k] - ends[0][k])
            low_k, high_k = ends[0][k] - margin, ends[1][k] + margin
            one["splits"] = prover.splits(one["rho"], low_k, high_k, k, most)
            for j in (j for j, other in enumerate(tied) if other == name):
                ends[0][j], ends[1][j] = low_k, high_k
    certificate = dataclasses.replace(certificate, lower=tuple(ends[0]), upper=tuple(ends[1]))
    if not (verdict := certificate.verify()).holds:
        fix = "Relax less, or design for bounds that are wider by as much."
        raise refuse("with_bounds", "relax", relax, "bounds for which the certificate holds", f"{verdict.why}. {fix}")
    travelling = Travelling(certificate, bounds)
    if not (found := checker_bounds.check(travelling.to_dict()))["holds"]:
        raise refuse("with_bounds", "f", found["why"], "formulas and bisections that `checker_bounds` accepts", "Relax more.")
    return travelling


def parameters(certificate: Any, jacobian: graph.Formulas) -> dict[int, Expression]:
    """The rho of each parameter, by its number in `tied`, with J = a + sum_k rho_k b_k c_k' exactly: Gaussian elimination in
    fractions, the right-hand sides being formulas."""
    tied = certificate.tied or tuple(range(len(certificate.lower)))
    names = list(dict.fromkeys(tied))
    a, b, c = ([[Fraction(x) for x in row] for row in matrix] for matrix in (certificate.a, certificate.b, certificate.c))
    rows = []
    for (i, j), entry in np.ndenumerate(jacobian.outputs):
        own = [sum((b[i][k] * c[k][j] for k, other in enumerate(tied) if other == name), Fraction(0)) for name in names]
        rows.append((own, combine((1, entry), (-1, constant(a[i][j])))))
    found: dict[int, Expression] = {}
    order = []
    for g, name in enumerate(names):
        pivot = next((row for row in rows if row[0][g] != 0 and not any(row[0][:g])), None)
        if pivot is None:
            fix = "Leave it out, or merge it with the others."
            raise refuse("with_bounds", "certificate", f"a parameter {name} that the others make", "independent b_k c_k'", fix)
        rows.remove(pivot)
        order.append((g, pivot))
        rows = [_eliminate(row, pivot, g) for row in rows]
    for own, rest in rows:
        if not rest.is_zero:
            text = jacobian.graph.text(rest)
            fix = "a, b, c must have the constants and coefficients of the Jacobian of f to the last bit."
            raise refuse("with_bounds", "certificate", f"channels that leave {text} of df/dx", "J = a + sum rho b c'", fix)
        assert not any(own)
    for g, (own, rest) in reversed(order):
        others = [(-own[h], found[names[h]]) for h in range(g + 1, len(names)) if own[h]]
        found[names[g]] = combine(*((k / own[g], e) for k, e in [(Fraction(1), rest), *others]))
    return {name: found[name] for name in names}


def _eliminate(row: Any, pivot: Any, g: int) -> Any:
    factor = row[0][g] / pivot[0][g]
    if factor == 0:
        return row
    return [x - factor * y for x, y in zip(row[0], pivot[0], strict=True)], combine((1, row[1]), (-factor, pivot[1]))


def _file(jacobian: graph.Formulas, rhos: Sequence[Expression], low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    """What travels, without the bisections: only the atoms that are needed, renumbered."""
    g, entries = jacobian.graph, list(jacobian.outputs.flat)
    kept = g.nodes([*entries, *rhos])
    place = {i: k for k, i in enumerate(kept)}
    for i in kept:
        if g.atoms[i][0] == "^" and not -64 <= g.atoms[i][2] <= 64:
            raise refuse("with_bounds", "f", f"the power {g.atoms[i][2]}", "powers from -64 to 64", "Write it as a product.")

    def form(e: Expression) -> list[Any]:
        return [_text(e.constant), *([place[i], _text(k)] for i, k in e.terms)]

    nodes = [[name, *(form(x) if isinstance(x, Expression) else x for x in args)] for name, *args in (g.atoms[i] for i in kept)]
    n = len(jacobian.outputs)
    return {
        "format": FORMAT,
        "variables": list(g.variables),
        "lower": [float(x).hex() for x in low],
        "upper": [float(x).hex() for x in high],
        "nodes": nodes,
        "jacobian": [[form(e) for e in entries[n * i : n * i + n]] for i in range(n)],
        "parameters": [{"rho": form(rho), "splits": [0]} for rho in rhos],
    }


def _text(x: Fraction) -> str:
    """A hex float if it is one, otherwise p/q."""
    value = float(x)
    return value.hex() if Fraction(value) == x else f"{x.numerator}/{x.denominator}"
