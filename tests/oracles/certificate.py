"""Condition (5) on stored numbers in exact arithmetic by python-flint: P from its linear equations, minors as determinants."""

from itertools import combinations_with_replacement

import flint


def rational(x):
    return flint.fmpq(*float(x).as_integer_ratio())


def riccati(gain):
    """(P, q) of A P + P A' + diag(q) = k k', P C' = k: as many linear equations as unknowns."""
    n = len(gain)
    pairs = list(combinations_with_replacement(range(n), 2))
    column = {pair: place for place, pair in enumerate(pairs)}
    unknowns = len(pairs) + n
    rows, right = [], []
    for i, j in pairs:
        terms = [column[tuple(sorted(pair))] for pair in ((i + 1, j), (i, j + 1)) if max(pair) < n]
        rows.append(terms + [len(pairs) + i] * (i == j))
        right.append(gain[i] * gain[j])
    for i in range(n):
        rows.append([column[0, i]])
        right.append(gain[i])
    dense = [flint.fmpq(row.count(place)) for row in rows for place in range(unknowns)]
    solved = flint.fmpq_mat(unknowns, unknowns, dense).solve(flint.fmpq_mat(unknowns, 1, right))
    p = [[solved[column[min(i, j), max(i, j)], 0] for j in range(n)] for i in range(n)]
    return p, [solved[len(pairs) + i, 0] for i in range(n)]


def positive(matrix):
    """Whether all leading minors of a symmetric matrix are positive."""
    return all(
        flint.fmpq_mat(k, k, [entry for row in matrix[:k] for entry in row[:k]]).det() > 0 for k in range(1, len(matrix) + 1)
    )


def holds(alphas, gamma, rho, mu, nu):
    """Whether the inequalities behind condition (5) hold for these floats, exactly."""
    gamma, rho, mu, nu = (rational(x) for x in (gamma, rho, mu, nu))
    if not (gamma > 0 and rho > 0 and mu > 0 and nu > 0):
        return False
    p, q = riccati([rational(a) * gamma**i for i, a in enumerate(alphas, start=1)])
    n = len(p)
    faster = [[(q[i] if i == j else 0) - mu * p[i][j] for j in range(n)] for i in range(n)]
    bounded = [[(nu if i == j else 0) - p[i][j] for j in range(n)] for i in range(n)]
    if not (all(x > 0 for x in q) and positive(p) and positive(faster) and positive(bounded)):
        return False
    corner = flint.fmpq_mat(n, n, [entry for row in p for entry in row]).inv()[n - 1, n - 1]
    return 4 * rho**2 * corner * nu < mu**2
