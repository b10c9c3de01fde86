"""Rational matrices: definiteness by determinants and characteristic polynomials, eigenvalues by isolated roots."""

import flint

from oracles.flint_certificates.fields import matrix


def identity(n):
    return diagonal([1] * n)


def diagonal(entries):
    n = len(entries)
    return flint.fmpq_mat(n, n, [entries[i] if i == j else 0 for i in range(n) for j in range(n)])


def zeros(rows, columns):
    return flint.fmpq_mat(rows, columns)


def sym(m):
    return m + m.transpose()


def trace(m):
    return sum((m[i, i] for i in range(m.nrows())), flint.fmpq(0))


def block(grid):
    """As numpy.block."""
    lines = [zip(*(part.tolist() for part in blocks), strict=True) for blocks in grid]
    rows = [[entry for part in parts for entry in part] for line in lines for parts in line]
    return matrix(rows, sum(part.ncols() for part in grid[0]))


def positive(m):
    """Symmetric, with positive determinants of all leading minors."""
    n = m.nrows()
    return m == m.transpose() and all(
        flint.fmpq_mat(k, k, [m[i, j] for i in range(k) for j in range(k)]).det() > 0 for k in range(1, n + 1)
    )


def semidefinite(m):
    """Symmetric, with no negative root of det(s - M): the coefficients change their signs, or vanish, as for roots >= 0."""
    n = m.nrows()
    return m == m.transpose() and all(coefficient * (-1) ** (n - k) >= 0 for k, coefficient in enumerate(m.charpoly().coeffs()))


def chain(n):
    """A: ones above the diagonal."""
    return flint.fmpq_mat(n, n, [int(j == i + 1) for i in range(n) for j in range(n)])


def first(n):
    """C = e_1'."""
    return flint.fmpq_mat(1, n, [int(j == 0) for j in range(n)])


def column(entries):
    return flint.fmpq_mat(len(entries), 1, list(entries))


def unstable(m, *, step, strictly=True):
    """Whether some eigenvalue has Re s > 0 (with `step` |z| > 1), or >= when not strictly."""
    polynomial = m.charpoly()
    if step:  # z = (1 + s) / (1 - s) maps the disc to the half plane; a root at z = -1 goes to infinity
        n, up, down = m.nrows(), flint.fmpq_poly([1, 1]), flint.fmpq_poly([1, -1])
        mapped = sum((c * up**k * down ** (n - k) for k, c in enumerate(polynomial.coeffs())), flint.fmpq_poly(0))
        if not strictly and mapped.degree() < n:
            return True
        polynomial = mapped
    return roots_right(polynomial, strictly=strictly)


def roots_right(polynomial, *, strictly):
    """Whether a rational polynomial has a root with Re s > 0, or Re s >= 0.

    The roots on the axis are among those of g = gcd(f(s), f(-s)), which lie symmetrically about 0; the others are so far from
    it that isolating balls of some precision tell their side. g = s^k h(s^2) has roots off the axis, on both sides, unless
    those of h are all real and <= 0.
    """
    common = polynomial.gcd(flint.fmpq_poly([(-1) ** k * c for k, c in enumerate(polynomial.coeffs())]))
    if any(side > 0 for side in _sides(polynomial / common)):
        return True
    if not strictly:
        return common.degree() > 0
    coefficients = common.coeffs()
    while coefficients[0] == 0:
        coefficients = coefficients[1:]
    h = flint.fmpq_poly(coefficients[::2])
    return sum(multiplicity for root, multiplicity in _roots(h, 128) if root.imag == 0) < h.degree() or any(
        side > 0 for side in _sides(h)
    )


def _roots(polynomial, bits):
    before, flint.ctx.prec = flint.ctx.prec, bits
    try:
        return [(flint.acb(root), multiplicity) for root, multiplicity in polynomial.numer().complex_roots()]
    finally:
        flint.ctx.prec = before


def _sides(polynomial):
    """The signs of the real parts of the roots, none of which is zero (or the root itself is)."""
    bits = 128
    while polynomial.degree() > 0:
        parts = [root.real for root, _ in _roots(polynomial, bits)]
        if all(part > 0 or part < 0 for part in parts):
            return [1 if part > 0 else -1 for part in parts]
        bits *= 2
    return []
