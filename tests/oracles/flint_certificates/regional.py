"""Theorems on e' = F(rho) e beyond decay: between samples, inside a set, and under a mismatch of the model."""

import flint

from oracles.flint_certificates import algebra
from oracles.flint_certificates.algebra import block, diagonal, identity, positive, sym
from oracles.flint_certificates.box import Box, decay, decreasing, driven, multipliers
from oracles.flint_certificates.fields import Malformed, matrix


def sampled(d):
    x, rate, delta = Box(d), d.scalar("rate"), d.scalar("delta")
    p, w = d.matrix("p", x.n, x.n), d.matrix("w", x.p, x.p)
    done = rate * delta
    yield x.ordered and rate >= 0 and delta > 0 and done < 1
    yield positive(p) and positive(w)
    k = flint.fmpq(98696, 40000) * (1 - done) + done**2
    for rho in x.vertices():
        f, g = x.f(rho), x.noise_gain(rho)
        corner, cross = -sym(p * f) - 2 * rate * p, -p * g
        held, seen = -delta * (x.output * f).transpose() * w, -delta * (x.output * g).transpose() * w
        yield positive(
            block([[corner, cross, held], [cross.transpose(), k * w, seen], [held.transpose(), seen.transpose(), w]])
        )


def sampled_tube(d):
    """K Q' - delta (M Q + Q M' + 2 rate Q) > 0 in Bernstein's form, Q_0 = diag(start, 0), start > the other ee blocks."""
    x, rate, delta = Box(d), d.scalar("rate"), d.scalar("delta")
    start, size, rows = d.matrix("start", x.n, x.n), x.n + x.p, d.rows("tube")
    degree = len(rows) // size
    if degree < 1 or len(rows) != degree * size:
        raise Malformed("tube")
    stacked = d.matrix("tube", degree * size, size).tolist()
    first = block([[start, algebra.zeros(x.n, x.p)], [algebra.zeros(x.p, x.n), algebra.zeros(x.p, x.p)]])
    q = [first] + [matrix(stacked[k * size : (k + 1) * size]) for k in range(degree)]
    yield x.ordered and rate >= 0 and delta > 0
    yield all(one == one.transpose() for one in q) and positive(start)
    yield all(positive(start - matrix([row[: x.n] for row in one.tolist()[: x.n]])) for one in q[1:])
    for rho in x.vertices():
        f, g = x.f(rho), x.noise_gain(rho)
        m = block([[f, g], [x.output * f, x.output * g]])
        for i in range(degree + 1):
            rise = algebra.zeros(size, size)
            if i > 0:
                rise += i * (q[i] - q[i - 1])
            if i < degree:
                rise += (degree - i) * (q[i + 1] - q[i])
            yield positive(rise - delta * (sym(m * q[i]) + 2 * rate * q[i]))


def regional(d):
    x, rate, level, radius = Box(d), d.scalar("rate"), d.scalar("level"), d.scalar("radius")
    p, faces = d.matrix("p", x.n, x.n), matrix(d.rows("faces", x.n), x.n)
    m = faces.nrows()
    sides = {name: d.vector(name, m) for name in ("inner_lower", "inner_upper", "outer_lower", "outer_upper")}
    yield rate >= 0 and level > 0 and radius >= 0
    yield all(low <= high for low, high in zip(sides["inner_lower"], sides["inner_upper"], strict=True))
    yield from decay(d, x, p, rate)
    yield positive(level * identity(x.n) - radius**2 * p)
    for j in range(m):
        w = min(sides["outer_upper"][j] - sides["inner_upper"][j], sides["inner_lower"][j] - sides["outer_lower"][j])
        row = flint.fmpq_mat(1, x.n, [faces[j, k] for k in range(x.n)])
        yield w > 0 and positive(block([[p, row.transpose()], [row, flint.fmpq_mat(1, 1, [w**2 / level])]]))


def mismatch(d):
    x = Box(d)
    p, weight = d.matrix("p", x.n, x.n), matrix(d.rows("weight", x.n), x.n)
    alpha, beta, gamma, size, noise, bound = (
        d.scalar(name) for name in ("alpha", "beta", "gamma", "size", "noise_size", "bound")
    )
    entering = matrix(d.rows("disturbance"))
    if entering.nrows() != x.n:
        raise Malformed("disturbance")
    tau, taus = multipliers(d, x, "taus")
    yield x.ordered and alpha > 0 and size >= 0 and noise >= 0 and bound >= 0
    yield tau >= 0 and all(t >= 0 for t in taus)
    yield not (any(t != 0 for t in taus) and d.given("inner"))  # the noise of those channels would have no vertex
    yield beta * size**2 + gamma * noise**2 <= alpha
    yield positive(block([[p, weight.transpose()], [weight, bound**2 * identity(weight.nrows())]]))
    weights = diagonal([beta] * entering.ncols() + [gamma] * x.p)
    for rho in x.vertices(taus):
        decrease = decreasing(d, x, p, alpha * p, tau, taus, rho)
        yield positive(driven(x, decrease, p, block([[entering, -x.noise_gain(rho)]]), weights))


JUDGES = {"mismatch": mismatch, "regional": regional, "sampled": sampled, "sampled-tube": sampled_tube}
