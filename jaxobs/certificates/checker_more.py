"""Decides more theorems of jaxobs-cert/1, as checker.py does, which lies beside it: the papers' own conditions, sampled data,
regions, disturbances; and with checker_negative.py all of them. Usage: python checker_more.py FILE...
"""

try: from jaxobs.certificates.checker_negative import *  # and all that checker.py has
except ImportError: from checker_negative import *

CHAIN = "the plant is x_i' = x_{{i+1}}, x_n' = phi(x, u), y = x_1, and the observer has the same phi"

@theorem("condition5", "alphas=n gamma= lipschitz= n:int q:int mu= nu=", "the error of the high-gain observer with n = {n} "
         "behind q = {q} integrators, gamma = {gamma}, alphas = {alphas} decays exponentially for every phi with Lipschitz "
         "constant {lipschitz}", (CHAIN, "phi is Lipschitz in x with this constant, for all u that occur (given, not proved)",
         MODEL[1]))
def condition5(d):
    a, n = [1, *d.alphas], len(d.alphas)
    yield f"{n} alphas for n = {d.n}, q = {d.q}: that n + q", d.n >= 1 and d.q >= 0 and n == d.n + d.q
    yield "positive gamma, Lipschitz constant, mu and nu", min(d.gamma, d.lipschitz, d.mu, d.nu) > 0
    weight = lambda i: a[i] ** 2 + 2 * sum((-1) ** j * a[i - j] * a[i + j] for j in range(1, min(i, n - i) + 1))
    weights = [weight(i) for i in range(1, n + 1)]
    yield from ((f"condition (10), q_{i} = {real(x):.6g} > 0,", x > 0) for i, x in enumerate(weights, 1))
    riccati = lambda i, j: sum((-1) ** m * a[j + m] * a[i - 1 - m] for m in range(min(i, n + 1 - j)))  # i <= j, at gamma = 1
    p = M([d.gamma ** (i + j - 1) * riccati(*sorted((i, j))) for j in range(1, n + 1)] for i in range(1, n + 1))
    q = diag([d.gamma ** (2 * i) * x for i, x in enumerate(weights, 1)])
    yield "the Riccati equation of P", not any(map(any, (sym(shifted([0] * n) @ p) - p[0] @ p[0].T + q).rows))
    yield from (("P > 0", p), ("Q - mu P > 0", q - d.mu * p), ("nu I - P > 0", d.nu * eye(n) - p))
    load = 4 * d.lipschitz**2 * d.nu * Fraction(pivots(p)[-2], pivots(p)[-1]) * cleared(p)[1]
    d.margins["decay_rate_of_V"] = real(d.mu) - real(load) ** 0.5
    d.margins["largest_lipschitz"] = real(d.lipschitz**2 * d.mu**2 / load) ** 0.5
    yield "4 rho^2 (P^-1)_NN nu < mu^2 (the margin must be positive)", load < d.mu**2

def shifted(gain):
    """A - L C of a chain: A the shift, C = e_1'."""
    return M([int(j == i + 1) - (x if j == 0 else 0) for j in range(len(gain))] for i, x in enumerate(gain))

@theorem("hg-lmi", "gain=n theta= j0:int lower=n upper=n constant= p=n,n lam= nu= sigma=", "the error with the gain L = "
         "{gain} (theta = {theta}, j0 = {j0}) decays exponentially for every phi with slopes in [{lower}, {upper}]", (CHAIN,
         "the slopes of phi stay in these bounds for all states and inputs (given, not proved)", MODEL[1]))
def high_gain_lmi(d):
    n, m = len(d.lower), len(d.lower) - d.j0
    last = SimpleNamespace(lower=d.lower[m:], upper=d.upper[m:], tied=[])
    yield "0 <= j0 <= n, theta >= 1, 0 < sigma <= theta", 0 <= m <= n and d.theta >= 1 and 0 < d.sigma <= d.theta
    yield "lambda, nu > 0 and constant >= 0", d.lam > 0 and d.nu > 0 and d.constant >= 0
    yield "(28), 0 within the bounds of the last j0 slopes,", all(lo <= 0 <= hi for lo, hi in zip(last.lower, last.upper))
    least = sum(max(abs(d.lower[i]), abs(d.upper[i])) ** 2 * d.theta ** (2 * (i + 1 - m)) for i in range(m))
    yield f"(30), the constant {real(d.constant):.9g} large enough for the slopes,", d.constant**2 >= least
    yield from (("P > 0", d.p), ("nu I - P > 0", d.nu * eye(n) - d.p))
    f = bent([x / d.theta**i for i, x in enumerate(d.gain, 1)], d.j0, d.sigma)
    found = vertices(last, lambda psi: -1 * (sym(d.p @ f(psi)) + d.lam * eye(n)))
    yield from ((f"F'P + P F + lambda I < 0, (31), {at(psi)}", x) for psi, x in found)
    d.margins["decay_rate"] = (d.theta * d.lam - 2 * d.constant * d.nu / d.theta**d.j0) / (2 * d.nu)
    yield "theta^{1+j0} lambda > 2 k nu, (32)", d.theta ** (1 + d.j0) * d.lam > 2 * d.constant * d.nu

def bent(gain, j0, scale):
    """psi -> A - L C + B psi' with the last j0 slopes psi_i / scale^{n+1-i}, (27)."""
    n, f = len(gain), shifted(gain)
    row = lambda psi: [0] * (n - j0) + [x / scale ** (j0 - i) for i, x in enumerate(psi)]
    return lambda psi: f + M([[0] * n] * (n - 1) + [row(psi)])

@theorem("no-hg-lmi", "gain=n? theta= j0:int lower=n upper=n constant= multipliers=R,n w=n,n", "(31)-(32) of the HG/LMI design "
         "with j0 = {j0} and the constant {constant} have no solution for the gain K = {gain}, or where that is empty for any, "
         "at theta = {theta} or less, for slopes in [{lower}, {upper}]", NONE)
def no_high_gain_lmi(d):
    n, total, mass, rows = len(d.lower), d.w, 0, d.multipliers.rows
    yield "0 <= j0 <= n, theta >= 1, constant >= 0", 0 <= d.j0 <= n and d.theta >= 1 and d.constant >= 0
    yield "(28), 0 within the bounds,", all(lo <= 0 <= hi for lo, hi in zip(d.lower, d.upper))
    ends = [sorted({lo, hi}) for lo, hi in zip(d.lower[n - d.j0 :], d.upper[n - d.j0 :])]
    yield "one multiplier a corner", len(rows) == n * math.prod(map(len, ends))
    f = bent(d.gain or [0] * n, d.j0, d.theta)
    for c, psi in enumerate(itertools.product(*ends)):
        x = M(rows[c * n : (c + 1) * n])
        yield f"X >= 0 at corner {c}", definite(x, semi=True)
        yield f"X C' = 0 at corner {c}", bool(d.gain) or not any(row[0] for row in x.rows)
        total, mass = total + sym(f(psi) @ x), mass + trace(x)
    yield "W >= 0", definite(d.w, semi=True)
    yield "W + sum (F X + X F') >= 0", definite(total, semi=True)
    d.margins["largest_lambda"] = trace(d.w) / mass if mass else math.inf
    yield "theta^{1+j0} tr W <= 2 k sum tr X > 0", mass > 0 and d.theta ** (1 + d.j0) * trace(d.w) <= 2 * d.constant * mass

HELD = ("e' = (a + sum_k rho_k b_k c_k) e - (gain + sum_k rho_k b_k inner_k) output e(t_k), t_k <= t < t_k+1, is the error of "
        "the observer: of the continuous plant, the innovation held; 0 < t_k+1 - t_k <= delta, intervals may vary; rho_k equal "
        "for equal numbers in tied = {tied}", *MODEL[1:])
SAMPLED = BOX + "inner=r,p? origin:str rate= delta= "
SLOWED = "with samples at most {delta} apart the error decays at least like exp(-{rate} t) from the first one on," + BOXED

@theorem("sampled", SAMPLED + "p=n,n w=p,p", SLOWED, HELD)
def sampled(d):
    x, c = d.rate * d.delta, d.delta * (d.w @ d.output)
    kappa = Fraction(98696, 40_000) * (1 - x) + x**2  # pi^2 > 9.8696
    yield from (("P > 0", d.p), ("W > 0", d.w), ("delta > 0, 0 <= rate delta < 1", d.delta > 0 and 0 <= x < 1))
    def whole(rho):
        f, g = closed(d, rho), injected(d, rho)
        pg, wf, wg = -1 * (d.p @ g), -1 * (c @ f), -1 * (c @ g)
        return block([-1 * sym(d.p @ f) - 2 * d.rate * d.p, pg, wf.T], [pg.T, kappa * d.w, wg.T], [wf, wg, d.w])
    yield from ((f"the decrease of V {at(rho)}", m) for rho, m in vertices(d, whole))
    d.margins["decay_rate"] = d.rate

@theorem("sampled-tube", SAMPLED + "start=n,n tube=N,m", SLOWED, HELD)
def sampled_tube(d):
    n, size, rows = len(d.a.rows), len(d.a.rows) + len(d.output.rows), d.tube.rows
    yield "delta > 0, rate >= 0, whole blocks Q_i", d.delta > 0 <= d.rate and len(rows) % size == 0 and len(rows[0]) == size
    short(cleared(d.tube)[0], 3 * size, len(rows) << len({*d.tied} or d.lower))
    zero = block([d.start, zeros(n, size - n)], [zeros(size - n, size)])
    q = [zero, *(M(rows[i : i + size]) for i in range(0, len(rows), size))]
    for i, x in enumerate(q):
        yield f"Q_{i} < Q_0 for e (Q_0 > 0)", d.start - M(row[:n] for row in x.rows[:n]) if i else d.start
        grows = i * (x - q[i - 1]) + (len(q) - 1 - i) * (q[min(i + 1, len(q) - 1)] - x) - 2 * d.rate * d.delta * x
        moved = lambda f: d.delta * sym(block([f], [d.output @ f]) @ x)
        found = vertices(d, lambda rho: grows - moved(block([closed(d, rho), injected(d, rho)])))
        yield from ((f"the growth of Q_{i} {at(rho)}", m) for rho, m in found)
    d.margins["decay_rate"] = d.rate

@theorem("regional", FULL + "rate= faces=f,n inner_lower=f inner_upper=f outer_lower=f outer_upper=f level= radius=", "every "
         "error with e(0)'P e(0) <= {level}, P = {p}, so any with |e(0)| <= {radius}, decays at least like exp(-{rate} t)" +
         BOXED,
         (*MODEL[:2], "rho stays within the stored bounds while H x and H xhat stay in [{outer_lower}, {outer_upper}], H = "
          "{faces} (bounds: {origin!r})", "H x stays in [{inner_lower}, {inner_upper}] at all times"))
def regional(d):
    yield from THEOREMS["corners"].builder(d)
    yield "level > 0, radius >= 0", d.level > 0 <= d.radius
    for j, h in enumerate(d.faces.rows):
        room = min(d.outer_upper[j] - d.inner_upper[j], d.inner_lower[j] - d.outer_lower[j])
        yield f"room at face {j}, its inner bounds in order", room > 0 and d.inner_lower[j] <= d.inner_upper[j]
        yield f"the region within face {j}", block([d.p, M([h]).T], [M([h]), M([[room**2 / d.level]])])
    yield "the ball within the region", d.level * eye(len(d.p.rows)) - d.radius**2 * d.p
    d.margins["radius"] = d.radius

DISTURBED = MODEL[0].replace("F(rho) e", "F(rho) e + disturbance d(t) - (gain + sum_k rho_k b_k inner_k) v(t)", 1)

@theorem("mismatch", FULL + "alpha= beta= gamma= disturbance=n,m size= noise_size= weight=s,n bound=", "|weight e(t)|^2 <= "
         "{bound}^2 (1 + exp(-{alpha} t) (e(0)'P e(0) - 1)), so |weight e| <= {bound} in the end, weight = {weight}, P = {p}," +
         BOXED,
         (DISTURBED, "|d| <= {size}, what the model lacks, disturbance = {disturbance}, and |v| <= {noise_size}, the noise of "
          "the measurement, at all times", *MODEL[1:]))
def mismatch(d):
    weights = [d.beta] * len(d.disturbance.rows[0]) + [d.gamma] * len(d.output.rows)
    yield from (("P > 0", d.p), ("alpha, bound > 0", min(d.alpha, d.bound) > 0))
    yield "no multipliers beside inner", not (any(d.taus) and d.inner.rows)
    inputs = lambda rho: (block([d.disturbance, -1 * injected(d, rho)]), weights)
    yield from decrease(d, d.p, d.alpha * d.p, d.taus, more=inputs)
    yield "sizes >= 0, beta size^2 + gamma noise_size^2 <= alpha", (
        min(d.size, d.noise_size) >= 0 and d.beta * d.size**2 + d.gamma * d.noise_size**2 <= d.alpha)
    yield "|weight e|^2 <= bound^2 e'P e", block([d.p, d.weight.T], [d.weight, d.bound**2 * eye(len(d.weight.rows))])
    d.margins["bound"] = d.bound

if __name__ == "__main__": sys.exit(main(sys.argv[1:]) if sys.argv[1:] else __doc__)
