"""Theorems that say what cannot be: errors that grow, and certificates or filters that do not exist."""

import itertools

import flint

from oracles.flint_certificates import algebra
from oracles.flint_certificates.algebra import block, chain, column, first, identity, positive, semidefinite, sym, trace
from oracles.flint_certificates.box import Box
from oracles.flint_certificates.fields import Malformed, matrix


def _step(d):
    step = d.integer("step")
    if step not in (0, 1):
        raise Malformed("step")
    return step


def frozen_instability(d):
    x, rho = Box(d, inner=False, origin=False), d.vector("rho")
    step = _step(d)
    yield x.ordered and x.holds(rho)
    yield algebra.unstable(x.f(rho), step=step)


def switching_instability(d):
    x, points, step = Box(d, inner=False, origin=False), d.rows("points"), _step(d)
    durations, repeats = d.vector("durations", len(points)), d.integer("repeats")
    if not 1 <= repeats <= 256 or len(d.integers("scale")) not in (
        0,
        x.n,
    ):  # coordinates against rounding, without a say in the truth
        raise Malformed("repeats or scale")
    yield x.ordered and all(x.holds(rho) for rho in points)
    yield min(durations) > 0 and not (step and any(t.q != 1 or t > 256 for t in durations))
    yield _trace_exceeds(x, points, durations, repeats, step)


def _trace_exceeds(x, points, durations, repeats, step):
    """|tr M^repeats| > n, in balls of as many bits as the answer needs; False if it never comes."""
    before = flint.ctx.prec
    try:
        for bits in (256, 2048, 16384):
            flint.ctx.prec = bits
            m = flint.arb_mat(identity(x.n))
            for rho, t in zip(points, durations, strict=True):
                f = x.f(rho)
                m = (_power(flint.arb_mat(f), int(t.p)) if step else (flint.arb_mat(f) * flint.arb(t)).exp()) * m
            size = abs(_power(m, repeats).trace())
            if size > x.n:
                return True
            if size <= x.n:
                return False
    finally:
        flint.ctx.prec = before
    return False


def _power(m, exponent):
    """By squaring, for exponents beyond those of a machine word."""
    result = flint.arb_mat(identity(m.nrows()))
    for digit in bin(exponent)[2:]:
        result = result * result * m if digit == "1" else result * result
    return result


def no_gain(d):
    """S >= 0 for S = sum F_c X_c + X_c F_c' + 2 rate X_c, X_c >= 0 not all zero; every gain, or every one |L| <= radius."""
    step, own = _step(d), d.given("gain")
    x, points, rate = Box(d, gain=own, inner=False, origin=False), d.rows("points"), d.scalar("rate")
    radius, t = d.scalar("radius"), d.scalar("t")
    stacked = d.matrix("multipliers", len(points) * x.n, x.n)
    multipliers = [matrix(stacked.tolist()[k * x.n : (k + 1) * x.n]) for k in range(len(points))]
    yield x.ordered and all(x.holds(rho) for rho in points)
    yield all(semidefinite(m) for m in multipliers) and any(trace(m) > 0 for m in multipliers)
    total, seen = algebra.zeros(x.n, x.n), algebra.zeros(x.n, x.p)
    for rho, m in zip(points, multipliers, strict=True):
        f = x.f(rho)
        total += f * m * f.transpose() - rate**2 * m if step else sym(f * m) + 2 * rate * m
        seen += m * x.output.transpose()
    if own:
        yield semidefinite(total)
    else:
        yield from _every_gain(x, total, seen, radius, t)


def _every_gain(x, total, seen, radius, t):
    if radius <= 0:
        yield seen == algebra.zeros(x.n, x.p)
        yield semidefinite(total)
    else:
        yield t > 0
        grid = [[total - t * radius**2 * identity(x.n), seen], [seen.transpose(), t * identity(x.p)]]
        yield semidefinite(block(grid))


def undetectable(d):
    """The kernel of [C; CA; ...] at rho is invariant; on it A has an eigenvalue with Re s >= -rate (|z| >= factor)."""
    x, rho, rate, step = Box(d, gain=False, inner=False, origin=False), d.vector("rho"), d.scalar("rate"), _step(d)
    yield x.ordered and x.holds(rho)
    a, rows = x.f(rho), x.output
    seen = [rows]
    for _ in range(x.n - 1):
        seen.append(seen[-1] * a)
    basis = _kernel(matrix([row for part in seen for row in part.tolist()], x.n))
    yield basis is not None
    gram = (basis.transpose() * basis).inv() * basis.transpose()
    inside = gram * a * basis
    if step:
        yield rate > 0
        yield algebra.unstable(inside * (1 / rate), step=step, strictly=False)
    else:
        yield algebra.unstable(inside + rate * identity(inside.nrows()), step=step, strictly=False)


def _kernel(m):
    """Columns that span the kernel, or None when it is {0}."""
    reduced, rank = m.rref()
    n = m.ncols()
    pivots = [next(j for j in range(n) if reduced[i, j] != 0) for i in range(rank)]
    free = [j for j in range(n) if j not in pivots]
    if not free:
        return None
    columns = [[-reduced[pivots.index(j), k] if j in pivots else int(j == k) for j in range(n)] for k in free]
    return matrix([[flint.fmpq(entry) for entry in one] for one in columns]).transpose()


def kalman_floor(d):
    x, rho, level = Box(d, gain=False, inner=False, origin=False), d.vector("rho"), d.scalar("level")
    weight, process, noise = d.rows("weight", x.n), d.rows("process"), d.rows("noise")
    s = d.matrix("s", x.n, x.n)
    if len(process) != x.n or len(noise) != x.p:
        raise Malformed("process or noise")
    e, w, v = matrix(weight, x.n), matrix(process), matrix(noise)
    yield x.ordered and x.holds(rho)
    yield s == s.transpose()
    side = s * x.output.transpose()
    yield positive(block([[sym(x.f(rho) * s) + w * w.transpose(), side], [side.transpose(), v * v.transpose()]]))
    yield trace(e * s * e.transpose()) >= level


def gain_floor(d):
    """det(s - A - rate I + L C) = s^n + sum_k (c_k + m_k L) s^{n-k} has positive coefficients at every rho where the error
    decays at the rate. With weights w >= 0, alpha = -sum w c > 0 and m = sum w m_k: m L > alpha, so |L| |m| > alpha."""
    x, points, rate, level = (
        Box(d, gain=False, inner=False, origin=False),
        d.rows("points"),
        d.scalar("rate"),
        d.scalar("level"),
    )
    weights = d.vector("weights", len(points) * x.n)
    if x.p != 1:
        raise Malformed("points or output")
    yield x.ordered and all(x.holds(rho) for rho in points)
    yield all(w >= 0 for w in weights) and any(w > 0 for w in weights) and level >= 0
    alpha, slopes = flint.fmpq(0), [flint.fmpq(0)] * x.n
    for place, rho in enumerate(points):
        a, own = x.f(rho) + rate * identity(x.n), weights[place * x.n : (place + 1) * x.n]
        constant = a.charpoly().coeffs()[-2::-1]
        alpha -= sum((w * c for w, c in zip(own, constant, strict=True)), flint.fmpq(0))
        for i in range(x.n):
            unit = column([int(j == i) for j in range(x.n)])
            moved = (a - unit * x.output).charpoly().coeffs()[-2::-1]
            slopes[i] += sum((w * (m - c) for w, m, c in zip(own, moved, constant, strict=True)), flint.fmpq(0))
    yield alpha > 0
    yield level**2 * sum((m**2 for m in slopes), flint.fmpq(0)) <= alpha**2


def no_hg_lmi(d):
    """W + sum_c (F_c X_c + X_c F_c') >= 0 and theta^{1+j0} tr W <= 2 constant sum_c tr X_c > 0, at the corners at theta."""
    lower, j0 = d.vector("lower"), d.integer("j0")
    n, upper = len(lower), d.vector("upper", len(lower))
    theta, constant, gain = d.scalar("theta"), d.scalar("constant"), d.given("gain")
    if not (n >= 1 and 0 <= j0 <= n):
        raise Malformed("sizes")
    psis = list(itertools.product(*(sorted({lower[i], upper[i]}) for i in range(n - j0, n))))
    stacked, w = d.matrix("multipliers", len(psis) * n, n).tolist(), d.matrix("w", n, n)
    k = column(d.vector("gain", n)) if gain else column([0] * n)
    yield theta >= 1 and constant >= 0 and all(low <= 0 <= high for low, high in zip(lower, upper, strict=True))
    yield semidefinite(w)
    sums, mass = w, flint.fmpq(0)
    for place, psi in enumerate(psis):
        x, f = matrix(stacked[place * n : (place + 1) * n]), chain(n) - k * first(n)
        bent = [value / theta ** (n + 1 - i) for i, value in zip(range(n - j0 + 1, n + 1), psi, strict=True)]
        f += flint.fmpq_mat(n, n, [0] * (n * n - j0) + bent)
        yield semidefinite(x) and (gain or not any(x[i, 0] for i in range(n)))
        sums, mass = sums + sym(f * x), mass + trace(x)
    yield mass > 0 and theta ** (1 + j0) * trace(w) <= 2 * constant * mass
    yield semidefinite(sums)


JUDGES = {
    "frozen-instability": frozen_instability,
    "gain-floor": gain_floor,
    "kalman-floor": kalman_floor,
    "no-gain": no_gain,
    "no-hg-lmi": no_hg_lmi,
    "switching-instability": switching_instability,
    "undetectable": undetectable,
}
