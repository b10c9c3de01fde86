"""Exact polynomials in one variable: integers, highest power first; real roots by Sturm's theorem."""

import itertools
import math
from collections.abc import Sequence
from fractions import Fraction

Polynomial = list[int]


def primitive(poly: Sequence[Fraction | int]) -> Polynomial:
    """The polynomial times a positive number: integer coefficients without a common factor; [] for zero."""
    common = math.lcm(*(Fraction(a).denominator for a in poly)) if poly else 1
    whole = [int(a * common) for a in poly]
    first = next((i for i, a in enumerate(whole) if a), len(whole))
    divisor = math.gcd(*whole[first:]) if first < len(whole) else 1
    return [a // divisor for a in whole[first:]]


def remainder(f: Polynomial, g: Polynomial) -> Polynomial:
    """f mod g times a positive number."""
    rest, lead = list(f), g[0]
    while len(rest) >= len(g):
        factor = rest[0] if lead > 0 else -rest[0]
        rest = [a * abs(lead) - factor * b for a, b in zip(rest, g + [0] * (len(rest) - len(g)), strict=True)][1:]
    return primitive(rest)


def euclid(f: Polynomial, g: Polynomial) -> list[Polynomial]:
    """f, g, -(f mod g), ...: the signed remainders, each up to a positive factor; the last one is gcd(f, g) up to sign."""
    chain = [f, g] if g else [f]
    while len(chain) > 1 and (rest := remainder(chain[-2], chain[-1])):
        chain.append([-a for a in rest])
    return chain


def gcd(f: Polynomial, g: Polynomial) -> Polynomial:
    return euclid(f, g)[-1]


def derivative(f: Polynomial) -> Polynomial:
    degree = len(f) - 1
    return primitive([a * (degree - i) for i, a in enumerate(f[:-1])])


def multiply(f: Polynomial, g: Polynomial) -> Polynomial:
    result = [0] * (len(f) + len(g) - 1) if f and g else []
    for i, a in enumerate(f):
        for j, b in enumerate(g):
            result[i + j] += a * b
    return result


def plus(f: Polynomial, g: Polynomial, factor: int = 1) -> Polynomial:
    """f + factor g."""
    size = max(len(f), len(g))
    one, other = [0] * (size - len(f)) + f, [0] * (size - len(g)) + g
    return [a + factor * b for a, b in zip(one, other, strict=True)]


def sign_at_infinity(f: Polynomial, side: int) -> int:
    """The sign of f towards +infinity (side = 1) or -infinity (side = -1)."""
    sign = 1 if f[0] > 0 else -1
    return sign * side if len(f) % 2 == 0 else sign


def variations(signs: Sequence[int]) -> int:
    kept = [s for s in signs if s]
    return sum(a != b for a, b in itertools.pairwise(kept))


def cauchy_index(chain: Sequence[Polynomial]) -> int:
    """The jumps of g/f from -infinity to +infinity less those back, along the real line, for chain = euclid(f, g)."""
    return variations([sign_at_infinity(f, -1) for f in chain]) - variations([sign_at_infinity(f, 1) for f in chain])


def distinct_real_roots(f: Polynomial) -> int:
    """Their number, by Sturm's theorem."""
    return cauchy_index(euclid(f, derivative(f))) if len(f) > 1 else 0


def real_roots(f: Polynomial) -> int:
    """Their number, counted with multiplicity: a root of multiplicity m is one of f, gcd(f, f'), ..., m times in all."""
    count = 0
    while len(f) > 1:
        count += distinct_real_roots(f)
        f = gcd(f, derivative(f))
    return count
