"""A point of the box at which no gain can work: found in floats, proved in exact arithmetic, before anything is solved.

(A, C) is detectable exactly when rank [A - s I; C] = n for all s with Re s >= 0 (|s| >= 1 in discrete time).
Source: Hautus, Indagationes Mathematicae 32 (1970) 448-455; the Popov-Belevitch-Hautus test, Kailath, Linear Systems, 1980.
"""

import dataclasses
import itertools
from fractions import Fraction

import numpy as np
import scipy.optimize

from jaxobs.certificates import Undetectability, exact, routh
from jaxobs.designs._frame import frame
from jaxobs.designs.polytope import Polytope

STARTS = 12  # of the search beyond the corners
LIMITS = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": 60}  # of each
DENOMINATORS = (1, 10, 100, 1000, 10**6)


@dataclasses.dataclass(frozen=True)
class Undetectable:
    """At the parameters rho (r,) the matrix A(rho) = a + sum_k rho_k b_k c_k' has the eigenvalue `eigenvalue`, not decaying as
    asked, with an eigenvector `direction` (n,) that the outputs do not see: whatever L, e' = (A(rho) - L C) e keeps it.

    is_exact: proved in rational arithmetic, the numbers of the model read as decimals; else found in floats. certificate: the
    proof for the floats as they are, None where rounding to them has moved the mode (0.1 + 0.2 is not 0.3).
    """

    rho: tuple[float, ...]
    eigenvalue: complex
    direction: tuple[complex, ...]
    is_exact: bool
    certificate: Undetectability | None = None

    def __str__(self) -> str:
        def shown(z: complex) -> str:
            return f"{z.real:.6g}" if abs(z.imag) < 1e-12 else f"{z.real:.6g}{z.imag:+.6g}i"

        how = "exactly" if self.is_exact else "in floats"
        at = ", ".join(f"{x:.6g}" for x in self.rho)
        mode = ", ".join(map(shown, self.direction))
        return f"undetectable at rho = ({at}), {how}: the mode ({mode}) with the eigenvalue {shown(self.eigenvalue)} has y = 0"


def undetectable(model: Polytope, *, rate: float = 0.0, step: bool = False) -> Undetectable | None:
    """A point of the box where some mode with Re s >= -rate (|s| >= rate for step models, then 1 if not given) is unobservable:

        (A(rho) - s I) v = 0,   C v = 0,   v != 0.

    rate [1/s], or the factor a step. None if the search finds none, which does not prove that there is none. Tried: all
    combinations of the ends, the middle and zero of each parameter (the first 2048 of them; with more than 5 parameters, no
    middle where the ends enclose zero), then a local search from random starts, rounded to decimals and tested exactly.
    Source: Hautus, 1970 (the Popov-Belevitch-Hautus test).
    """
    limit = (rate if rate else 1.0) if step else rate
    for rho in _grid(model):
        if found := _tested(model, rho, limit, step):
            return found
    best = None
    for hit in _searched(model, limit, step):
        for denominator in DENOMINATORS:
            rho = tuple(Fraction(x).limit_denominator(denominator) for x in hit)
            inside = all(_exactly(lo) <= x <= _exactly(hi) for lo, x, hi in zip(model.lower, rho, model.upper, strict=True))
            if inside and (found := _tested(model, rho, limit, step)):
                return found
        best = best or _in_floats(model, hit, limit, step)
    return best


def _exactly(x: float) -> Fraction:
    """The shortest decimal that is this float: 0.2 is 1/5."""
    return Fraction(repr(float(x)))


def _grid(model: Polytope):
    first = [model.tied.index(k) for k in model.tied]
    own = sorted(set(first))
    choices = []
    for k in own:
        lo, hi = _exactly(model.lower[k]), _exactly(model.upper[k])
        choices.append(list(dict.fromkeys([*([Fraction(0)] if lo <= 0 <= hi else []), lo, hi, (lo + hi) / 2])))
    if len(own) > 5:
        choices = [values[:3] for values in choices]
    for values in itertools.islice(itertools.product(*choices), 2048):
        yield tuple(values[own.index(k)] for k in first)


def _rational(array: np.ndarray) -> exact.Matrix:
    return [[_exactly(x) for x in row] for row in array]


def _at(model: Polytope, rho: tuple[Fraction, ...]) -> exact.Matrix:
    a, b, c = _rational(model.a), _rational(model.b), _rational(model.c)
    for k, value in enumerate(rho):
        a = exact.add(a, [[value * row[k] * entry for entry in c[k]] for row in b])
    return a


def _tested(model: Polytope, rho: tuple[Fraction, ...], limit: float, step: bool) -> Undetectable | None:
    """Exact: the unobservable subspace N of (A(rho), C), and whether the spectrum of A(rho) on N decays as asked."""
    a, rows, n = _at(model, rho), _rational(model.output), model.n
    stacked = list(rows)
    for _ in range(n - 1):
        rows = exact.product(rows, a)
        stacked += rows
    basis = exact.kernel(stacked, n)
    if not basis:
        return None
    # A N = N X: each basis vector has a 1 where the others have 0, so that X is read off there.
    free = [next(j for j in range(n) if v[j] == 1 and all(w[j] == 0 for w in basis if w is not v)) for v in basis]
    image = exact.product(a, exact.transpose(basis))
    on_subspace = [image[j] for j in free]
    bound = Fraction(limit)
    size = range(len(basis))
    if step:
        scaled = [[x / bound for x in row] for row in on_subspace]
    else:
        scaled = [[x + (bound if i == j else 0) for j, x in enumerate(row)] for i, row in zip(size, on_subspace, strict=True)]
    if routh.frozen(scaled, step=step).is_stable:
        return None
    values, vectors = np.linalg.eig(np.array(on_subspace, float))
    worst = int(np.argmax(np.abs(values) if step else np.real(values)))
    direction = np.array(basis, float).T @ vectors[:, worst]
    floats = tuple(map(float, rho))
    certificate = Undetectability(**model.fields(), rho=floats, rate=float(limit), step=int(step))
    proved = certificate if certificate.verify() else None
    return Undetectable(floats, complex(values[worst]), _normal(direction), True, proved)


def _normal(v: np.ndarray) -> tuple[complex, ...]:
    return tuple(complex(x) for x in v / v[np.argmax(np.abs(v))])


def _searched(model: Polytope, limit: float, step: bool):
    """Zeros of |(A(rho) - s I) v|^2 + |C v|^2 + (|v|^2 - 1)^2 over rho in the box and Re s not decaying, by Gauss-Newton steps
    in the coordinates and the time (the delta form, for step models) in which the model is balanced."""
    place = frame(model, step=step)
    balanced, n = place.model, model.n
    first = [model.tied.index(k) for k in model.tied]
    free = [k for k in sorted(set(first)) if model.lower[k] < model.upper[k]]
    if not free:
        return
    directions = [sum(np.outer(balanced.b[:, j], balanced.c[j]) for j in range(model.r) if first[j] == k) for k in free]
    output = balanced.output / np.linalg.norm(balanced.output, axis=1, keepdims=True)
    lower, upper = model.lower[free], model.upper[free]
    base = balanced.at(np.where(np.isin(first, free), 0.0, model.lower))

    def parts(x: np.ndarray):
        a = base + sum(rho * d for rho, d in zip(lower + x[: len(free)] * (upper - lower), directions, strict=True))
        v, w = x[-2 * n : -n], x[-n:]  # v + i w
        return a, x[len(free)], x[len(free) + 1], v, w

    def residual(x: np.ndarray) -> np.ndarray:
        a, s, o, v, w = parts(x)
        return np.concatenate([a @ v - s * v + o * w, a @ w - s * w - o * v, output @ v, output @ w, [v @ v + w @ w - 1]])

    def slopes(x: np.ndarray) -> np.ndarray:
        a, s, o, v, w = parts(x)
        zero, still = np.zeros((len(output), 1)), np.zeros((len(output), n))
        turn = o * np.eye(n)
        columns = [np.concatenate([d @ v, d @ w]) * width for d, width in zip(directions, upper - lower, strict=True)] + [
            np.concatenate([-v, -w]),
            np.concatenate([w, -v]),
        ]
        top = np.column_stack(columns)
        rest = np.block([[a - s * np.eye(n), turn], [-turn, a - s * np.eye(n)], [output, still], [still, output]])
        left = np.vstack([top, np.zeros((2 * len(zero), top.shape[1])), np.zeros((1, top.shape[1]))])
        return np.hstack([left, np.vstack([rest, 2 * np.concatenate([v, w])])])

    slowest = 0.0 if step else -limit / place.speed
    low = np.concatenate([np.zeros(len(free)), [slowest, -2.0], np.full(2 * n, -2.0)])
    high = np.concatenate([np.ones(len(free)), [slowest + 2.0, 2.0], np.full(2 * n, 2.0)])
    rng = np.random.default_rng(0)
    for start in range(STARTS):
        v = np.concatenate([rng.normal(size=n), rng.normal(size=n) * (start % 2)])
        s = [slowest + 0.3 * rng.random() ** 2, 0.3 * rng.normal() * (start % 2)]
        x0 = np.clip(np.concatenate([rng.random(len(free)), s, v / np.linalg.norm(v)]), low, high)
        found = scipy.optimize.least_squares(residual, x0, slopes, (low, high), **LIMITS)  # pyright: ignore[reportArgumentType]
        if np.max(np.abs(found.fun)) < 1e-9:
            rho = np.where(np.isin(first, free), 0.0, model.lower)
            for j, k in enumerate(first):
                if k in free:
                    rho[j] = lower[free.index(k)] + found.x[free.index(k)] * (upper - lower)[free.index(k)]
            yield rho


def _in_floats(model: Polytope, rho: np.ndarray, limit: float, step: bool) -> Undetectable | None:
    """The same test with a rank tolerance."""
    values, vectors = np.linalg.eig(model.at(rho))
    for s, v in zip(values, vectors.T, strict=True):
        grows = abs(s) >= limit - 1e-9 if step else s.real >= -limit - 1e-9
        if grows and np.linalg.norm(model.output @ v) < 1e-7:
            return Undetectable(tuple(float(x) for x in rho), complex(s), _normal(v), False)
    return None
