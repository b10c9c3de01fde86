"""Theorems on chains: x_i' = x_{i+1}, x_n' = phi or f, y = x_1 (papers 000 and 002)."""

import itertools

import flint

from oracles.certificate import riccati
from oracles.flint_certificates.algebra import chain, column, diagonal, first, identity, positive, sym
from oracles.flint_certificates.fields import Malformed, matrix


def condition5(d):
    alphas, n, q = d.vector("alphas"), d.integer("n"), d.integer("q")
    gamma, rho, mu, nu = (d.scalar(name) for name in ("gamma", "lipschitz", "mu", "nu"))
    if not (n >= 1 and q >= 0 and len(alphas) == n + q):
        raise Malformed("sizes")
    yield min(gamma, rho, mu, nu) > 0
    size = n + q
    rows, weights = riccati([alpha * gamma**i for i, alpha in enumerate(alphas, start=1)])
    p = matrix(rows)
    yield min(weights) > 0
    yield positive(p)
    yield positive(diagonal(weights) - mu * p)
    yield positive(nu * identity(size) - p)
    yield 4 * rho**2 * p.inv()[size - 1, size - 1] * nu < mu**2


def hg_lmi(d):
    """(31)-(32) of paper 002."""
    gain = d.vector("gain")
    n, j0 = len(gain), d.integer("j0")
    if not (n >= 1 and 0 <= j0 <= n):
        raise Malformed("sizes")
    lower, upper = d.vector("lower", n), d.vector("upper", n)
    theta, sigma, constant, lam, nu = (d.scalar(name) for name in ("theta", "sigma", "constant", "lam", "nu"))
    p = d.matrix("p", n, n)
    yield theta >= 1 and theta >= sigma > 0
    yield constant >= 0
    yield all(low <= high for low, high in zip(lower, upper, strict=True))
    yield all(low <= 0 <= high for low, high in zip(lower[n - j0 :], upper[n - j0 :], strict=True))
    sizes = [max(abs(low), abs(high)) for low, high in zip(lower, upper, strict=True)]
    yield constant**2 >= sum((sizes[i - 1] ** 2 * theta ** (2 * (i - n + j0)) for i in range(1, n - j0 + 1)), flint.fmpq(0))
    yield positive(p)
    yield positive(nu * identity(n) - p)
    yield theta ** (1 + j0) * lam > 2 * constant * nu
    k = chain(n) - column([entry / theta**i for i, entry in enumerate(gain, start=1)]) * first(n)
    for psi in _corners(n, j0, sigma, lower, upper):
        last = flint.fmpq_mat(n, n, [0] * (n * n - n) + psi)
        yield positive(-sym(p * (k + last)) - lam * identity(n))


def _corners(n, j0, sigma, lower, upper):
    """(27): psi_i / sigma^{n+1-i} for the last j0 slopes at either bound, zeros before them."""
    free = range(n - j0 + 1, n + 1)
    for chosen in itertools.product(*((lower[i - 1], upper[i - 1]) for i in free)):
        yield [0] * (n - j0) + [x / sigma ** (n + 1 - i) for x, i in zip(chosen, free, strict=True)]


JUDGES = {"condition5": condition5, "hg-lmi": hg_lmi}
