"""Theorems on e' = F(rho) e, F(rho) = a + sum_k rho_k b_k (c_k - inner_k output) - gain output, rho in a box (e+ with step)."""

import itertools

import flint

from oracles.flint_certificates import algebra
from oracles.flint_certificates.algebra import block, identity, positive, sym, trace
from oracles.flint_certificates.fields import Malformed, matrix


class Box:
    """The stored dynamics. Malformed where channels that are tied have different bounds, or a bound is missing."""

    def __init__(self, d, *, gain=True, inner=True, origin=True):
        a = d.rows("a")
        self.n = n = len(a)
        if origin:
            d.text("origin")
        self.a = d.matrix("a", n, n)
        self.lower = d.vector("lower")
        self.r = r = len(self.lower)
        self.upper = d.vector("upper", r)
        self.b, self.c = d.matrix("b", n, r), d.matrix("c", r, n)
        self.output = d.matrix("output", len(d.rows("output", n)), n)
        self.p = self.output.nrows()
        self.gain = d.matrix("gain", n, self.p) if gain else algebra.zeros(n, self.p)
        self.inner = d.matrix("inner", r, self.p) if inner and d.given("inner") else algebra.zeros(r, self.p)
        self.tied = d.integers("tied") or list(range(r))
        if n == 0 or self.p == 0 or len(self.tied) != r:
            raise Malformed("empty, or tied of another length")
        ends = list(zip(self.lower, self.upper, strict=True))
        if any(ends[j] != ends[k] for j in range(r) for k in range(r) if self.tied[j] == self.tied[k]):
            raise Malformed("tied channels with different bounds")
        self.ordered = all(low <= high for low, high in ends)

    def f(self, rho):
        """F(rho)."""
        return self.a + self.b * algebra.diagonal(rho) * (self.c - self.inner * self.output) - self.gain * self.output

    def noise_gain(self, rho):
        """gain + b diag(rho) inner: how the noise of the output enters."""
        return self.gain + self.b * algebra.diagonal(rho) * self.inner

    def vertices(self, taus=()):
        """All of them; channels with a multiplier stay at 0, the others with their own numbers."""
        own = list(dict.fromkeys(name for k, name in enumerate(self.tied) if not (taus and taus[k])))
        ends = {name: (self.lower[k], self.upper[k]) for k, name in enumerate(self.tied)}
        for chosen in itertools.product(*(sorted(set(ends[name])) for name in own)):
            value = dict(zip(own, chosen, strict=True))
            yield [flint.fmpq(0) if taus and taus[k] else value[name] for k, name in enumerate(self.tied)]

    def holds(self, rho):
        """Whether these values are in the box, equal where tied."""
        if len(rho) != self.r:
            raise Malformed(f"{len(rho)} parameters for {self.r}")
        inside = all(low <= x <= high for low, x, high in zip(self.lower, rho, self.upper, strict=True))
        return inside and all(rho[j] == rho[k] for j in range(self.r) for k in range(self.r) if self.tied[j] == self.tied[k])


def corners(d):
    x, rate = Box(d), d.scalar("rate")
    p = d.matrix("p", x.n, x.n)
    yield rate >= 0
    yield from decay(d, x, p, rate)


def decay(d, x, p, rate):
    """P > 0, and e'P e falls at the rate, with the slopes of `taus` and the block Delta by multipliers."""
    tau, taus = multipliers(d, x, "taus")
    yield x.ordered
    yield positive(p)
    yield tau >= 0 and all(t >= 0 for t in taus)
    for rho in x.vertices(taus):
        yield positive(decreasing(d, x, p, 2 * rate * p, tau, taus, rho))


def multipliers(d, x, name):
    """tau, and one multiplier a channel, 0 for those by corners."""
    taus = d.vector(name, x.r) if d.given(name) else [flint.fmpq(0)] * x.r
    return d.scalar("tau"), taus


def _delta(d, x):
    """left (n, u), right (v, n) of the block Delta; no columns where there is none."""
    if not (d.given("left") or d.given("right")):
        return algebra.zeros(x.n, 0), algebra.zeros(0, x.n)
    left, right = d.rows("left"), d.rows("right", x.n)
    if len(left) != x.n or not left[0] or not right:
        raise Malformed("left or right")
    return matrix(left), matrix(right)


def _supply(d, x, tau, taus):
    """Of w_k = rho_k v_k and z = Delta right e the sum of tau_k (w_k - l_k v_k)(u_k v_k - w_k) and tau (|right e|^2 - |z|^2):
    its matrix in (e, w, z), w only of the channels with tau_k > 0; and how w and z enter."""
    left, right = _delta(d, x)
    free = [k for k in range(x.r) if taus[k] != 0]
    size = x.n + len(free) + left.ncols()
    v = x.c - x.inner * x.output
    form = algebra.zeros(size, size)

    def add(weight, one, other):
        rows = [flint.fmpq_mat(1, size, list(row) + [0] * (size - len(row))) for row in (one, other)]
        return weight / 2 * sym(rows[0].transpose() * rows[1])

    for place, k in enumerate(free):
        seen, w = [v[k, j] for j in range(x.n)], [int(i == place) for i in range(len(free))]
        form += add(
            taus[k], [-x.lower[k] * entry for entry in seen] + w, [x.upper[k] * e for e in seen] + [-entry for entry in w]
        )
    for i in range(right.nrows()):
        row = [right[i, j] for j in range(x.n)]
        form += add(tau, row, row)
    for i in range(left.ncols()):
        unit = [0] * (x.n + len(free)) + [int(j == i) for j in range(left.ncols())]
        form -= add(tau, unit, unit)
    columns = [[x.b[i, k] for k in free] + [left[i, j] for j in range(left.ncols())] for i in range(x.n)]
    return form, matrix(columns, len(free) + left.ncols())


def decreasing(d, x, p, load, tau, taus, rho, step=False, scale=1):
    """Minus (2 e'P (F e + B w) + e'load e + supply), or with step scale e'P e - |F e + B w|_P^2 - supply, as a matrix."""
    form, b = _supply(d, x, tau, taus)
    moves = block([[x.f([0 if t else r for t, r in zip(taus, rho, strict=True)]), b]])
    state = block([[identity(x.n), algebra.zeros(x.n, b.ncols())]])
    if step:
        return scale * state.transpose() * p * state - moves.transpose() * p * moves - form
    return -sym(state.transpose() * p * moves) - state.transpose() * load * state - form


def step_corners(d):
    x, factor = Box(d), d.scalar("factor")
    p, (tau, taus) = d.matrix("p", x.n, x.n), multipliers(d, x, "taus")
    yield 0 < factor <= 1
    yield x.ordered
    yield positive(p)
    yield tau >= 0 and all(t >= 0 for t in taus)
    for rho in x.vertices(taus):
        yield positive(decreasing(d, x, p, None, tau, taus, rho, step=True, scale=factor**2))


def _noise(d, x, names):
    for name in names:
        if d.given(name):
            d.matrix(name, x.n, x.n)
    weight = matrix(d.rows("weight", x.n), x.n)
    process = d.rows("process")
    noise = d.rows("noise")
    if len(process) != x.n or len(noise) != x.p:
        raise Malformed("process or noise")
    return weight, matrix(process), matrix(noise)


def h2(d):
    x, rate, level = Box(d), d.scalar("rate"), d.scalar("level")
    p = d.matrix("p", x.n, x.n)
    weight, process, noise = _noise(d, x, ("q", "x"))
    yield rate >= 0
    yield from decay(d, x, p, rate)
    if d.given("q"):
        yield from _energy(d, x, weight)
        q = d.matrix("q", x.n, x.n)
        for rho in x.vertices():
            entering = x.noise_gain(rho) * noise
            yield trace(process.transpose() * q * process) + trace(entering.transpose() * q * entering) <= level
    else:
        covariance = d.matrix("x", x.n, x.n)
        yield _delta(d, x)[0].ncols() == 0
        yield positive(covariance)
        yield trace(weight * covariance * weight.transpose()) <= level
        for rho in x.vertices():
            entering = x.noise_gain(rho) * noise
            spread = process * process.transpose() + entering * entering.transpose()
            yield positive(-sym(x.f(rho) * covariance) - spread)


def _energy(d, x, weight, more=lambda rho: None):
    """Q > 0 and F'Q + Q F + E'E < 0 by multipliers taus_q; with inputs, G of them and the level on the diagonal."""
    q, (tau, taus) = d.matrix("q", x.n, x.n), multipliers(d, x, "taus_q")
    yield positive(q)
    yield tau >= 0 and all(t >= 0 for t in taus)
    yield not (any(t != 0 for t in taus) and d.given("inner"))  # the noise of those channels would have no vertex
    for rho in x.vertices(taus):
        decrease = decreasing(d, x, q, weight.transpose() * weight, tau, taus, rho)
        if (inputs := more(rho)) is not None:
            g, square = inputs
            decrease = driven(x, decrease, q, g, square * identity(g.ncols()))
        yield positive(decrease)


def driven(x, decrease, p, g, weights):
    """With inputs e' = ... + G w, whose weights V' may use: [decrease, -P G; *, weights]."""
    side = block([[-p * g], [algebra.zeros(decrease.nrows() - x.n, g.ncols())]])
    return block([[decrease, side], [side.transpose(), weights]])


def l2(d):
    x, rate, level = Box(d), d.scalar("rate"), d.scalar("level")
    p = d.matrix("p", x.n, x.n)
    weight, process, noise = _noise(d, x, ("q",))
    yield rate >= 0
    yield level >= 0
    yield from decay(d, x, p, rate)
    yield from _energy(d, x, weight, lambda rho: (block([[process, -x.noise_gain(rho) * noise]]), level**2))


JUDGES = {"corners": corners, "h2": h2, "l2": l2, "step-corners": step_corners}
