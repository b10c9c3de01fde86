"""Decides the other theorems of jaxobs-cert/1 as checker.py does, which lies beside it: the papers' own conditions, sampled data,
regions, disturbances, and negative answers. Usage: python checker_more.py FILE...
"""

try: from jaxobs.certificates.checker import *  # its matrices, its reading of files, its theorems
except ImportError: from checker import *

CHAIN = "the plant is x_i' = x_{{i+1}}, x_n' = phi(x, u), y = x_1, and the observer has the same phi"
NONE = ("a statement on the stored matrices; another kind of proof may exist, and the observer may converge",)

@theorem("condition5", "alphas=n gamma= lipschitz= n:int q:int mu= nu=", "the error of the high-gain observer with n = {n} behind "
         "q = {q} integrators, gamma = {gamma}, alphas = {alphas} decays exponentially for every phi with Lipschitz constant "
         "{lipschitz}", (CHAIN, "phi has that Lipschitz constant in x, for all u that occur (given, not proved)",
         "gains alphas_i gamma^i are real numbers, carried out without rounding"))
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

@theorem("hg-lmi", "gain=n theta= j0:int lower=n upper=n constant= p=n,n lam= nu= sigma=", "the error with the gain L = {gain} "
         "(theta = {theta}, j0 = {j0}) decays exponentially for every phi with slopes in [{lower}, {upper}]", (CHAIN, "the slopes of phi "
         "stay in these bounds for all states and inputs (given, not proved)", "gains are real numbers, carried out without rounding"))
def high_gain_lmi(d):
    n, m = len(d.lower), len(d.lower) - d.j0
    last = SimpleNamespace(lower=d.lower[m:], upper=d.upper[m:], tied=[])
    yield "0 <= j0 <= n, theta >= 1, 0 < sigma <= theta", 0 <= m <= n and d.theta >= 1 and 0 < d.sigma <= d.theta
    yield "lambda, nu > 0 and constant >= 0", d.lam > 0 and d.nu > 0 and d.constant >= 0
    yield "(28), 0 within the bounds of the last j0 slopes,", all(lo <= 0 <= hi for lo, hi in zip(last.lower, last.upper))
    least = sum(max(abs(d.lower[i]), abs(d.upper[i])) ** 2 * d.theta ** (2 * (i + 1 - m)) for i in range(m))
    yield f"(30), the constant {real(d.constant):.9g} large enough for the slopes,", d.constant**2 >= least
    yield from (("P > 0", d.p), ("nu I - P > 0", d.nu * eye(n) - d.p))
    f = shifted([x / d.theta**i for i, x in enumerate(d.gain, 1)])
    bent = lambda psi: f + M([[0] * n] * (n - 1) + [[0] * m + [x / d.sigma ** (d.j0 - i) for i, x in enumerate(psi)]])
    found = vertices(last, lambda psi: -1 * (sym(d.p @ bent(psi)) + d.lam * eye(n)))
    yield from ((f"F'P + P F + lambda I < 0, (31), {at(psi)}", x) for psi, x in found)
    d.margins["decay_rate"] = (d.theta * d.lam - 2 * d.constant * d.nu / d.theta**d.j0) / (2 * d.nu)
    yield "theta^{1+j0} lambda > 2 k nu, (32)", d.theta ** (1 + d.j0) * d.lam > 2 * d.constant * d.nu

@theorem("no-gain", BOX.replace("gain=n,p", "gain=n,p?") + "points=N,r multipliers=R,n rate= step:int radius= t=", "no P > 0 makes "
         "e'P e decay at the rate {rate} (step = {step}: factor) at all parameters {points}, with L = {gain}; where that is empty, with "
         "no L at all (radius {radius} > 0: no L of |L| <= radius); for a single point: no such L makes all errors decay like that", NONE)
def no_gain(d):
    n, rows, total, g = len(d.a.rows), d.multipliers.rows, 0 * d.a, 0 * d.output.T
    any_gain, d.inner, d.gain = not d.gain.rows, M([]), d.gain if d.gain.rows else g
    yield "one multiplier a point, step 0 or 1", len(rows) == n * len(d.points.rows) and d.step in (0, 1)
    for c, rho in enumerate(d.points.rows):
        f, x = closed(d, rho), M(rows[c * n : (c + 1) * n])
        yield f"the box containing point {c}", contained(d, rho)
        yield f"X >= 0 at point {c}", definite(x, semi=True)
        total, g = total + (f @ x @ f.T - d.rate**2 * x if d.step else sym(f @ x) + 2 * d.rate * x), g + x @ d.output.T
    yield "some X not zero", any(map(any, rows))
    if any_gain and d.radius > 0:
        yield "t > 0, continuous time", d.t > 0 and not d.step
        total = block([total - d.t * d.radius**2 * eye(n), g], [g.T, d.t * eye(len(d.output.rows))])
    elif any_gain: yield "sum X output' = 0", not any(map(any, g.rows))
    yield "sum F X + X F' + 2 rate X >= 0", definite(total, semi=True)

def contained(d, rho):
    tied = d.tied or list(range(len(rho)))
    return all(lo <= x <= hi and x == rho[tied.index(t)] for lo, x, hi, t in zip(d.lower, rho, d.upper, tied))

@theorem("kalman-floor", BOX.replace("gain=n,p ", "") + "rho=r weight=s,n process=n,m noise=p,k s=n,n level=", "no linear unbiased "
         "filter at the constant rho = {rho} has a smaller mean of |weight e|^2 than {level}", NONE)
def kalman_floor(d):
    d.gain, d.inner, so, v = 0 * d.output.T, M([]), d.s @ d.output.T, d.noise @ d.noise.T
    yield "the box containing rho", contained(d, d.rho)
    yield "V > 0", v
    yield "the Riccati inequality of S", block([sym(closed(d, d.rho) @ d.s) + d.process @ d.process.T, so], [so.T, v])
    yield "tr E S E' >= level", trace(d.weight @ d.s @ d.weight.T) >= d.level

FROZEN = "{moves} = F(rho) e, F = a + sum_k rho_k b_k c_k - gain output, is the error of the observer"
SWITCHED = (FROZEN, "the parameters can switch at once between any two values")

@theorem("frozen-instability", BOX + "rho=r step:int", "with the gain L = {gain} and the constant parameters {rho} some errors "
         "grow exponentially", (FROZEN,))
def frozen_instability(d):
    d.inner = M([])
    yield "step 0 or 1", d.step in (0, 1)
    yield "the box containing rho", contained(d, d.rho)
    d.margins["outside"] = outside(closed(d, d.rho), d.step)
    yield f"an eigenvalue {'outside the unit circle' if d.step else 'in the open right half plane'}", d.margins["outside"] > 0

def routh(f, step):
    """The first column of Routh's scheme for the eigenvalues of f (step: about the unit circle), None where it breaks off. Without
    a change of sign they lie inside; each change is one outside."""
    n, c, power = len(f.rows), [Fraction(1)], f
    for k in range(1, n + 1):  # the characteristic polynomial, by Faddeev and LeVerrier
        c.append(-Fraction(trace(power)) / k)
        power = f @ (power + c[-1] * eye(n))
    if step:  # (1 - s)^n p((1 + s) / (1 - s)), the highest power first
        part = lambda k, m: sum((-1) ** j * math.comb(k, j) * math.comb(n - k, m - j) for j in range(m + 1))
        c = [sum(x * part(k, m) for k, x in enumerate(c)) for m in range(n, -1, -1)]
    a, b, first = c[::2], c[1::2], c[:1]
    while b and a[0] and b[0]:
        first.append(b[0])
        a, b = b, [x - a[0] * y / b[0] for x, y in itertools.zip_longest(a[1:], b[1:], fillvalue=0)]
    return first if a[0] and not b else None

def outside(f, step):
    """How many eigenvalues have Re s > 0 (|z| > 1), by Routh's scheme; where that breaks off, at least: for f moved inward a bit."""
    short(cleared(f)[0], len(f.rows), 100)
    for h in (0, Fraction(1, 2**40), Fraction(1, 2**80)):
        first = routh(1 / (1 + Fraction(h)) * f if step else f - h * eye(len(f.rows)), step)
        if first is not None: return sum(x * y < 0 for x, y in itertools.pairwise(first))
    return 0

@theorem("undetectable", BOX.replace("gain=n,p ", "") + "rho=r rate= step:int", "at the constant rho = {rho} the outputs do not see a "
         "mode that no gain moves and that does not decay at the rate {rate} (step = {step}: factor) or faster", NONE)
def undetectable(d):
    d.gain, d.inner, part = 0 * d.output.T, M([]), d.output
    yield "the box containing rho, step 0 or 1", contained(d, d.rho) and d.step in (0, 1)
    yield "rate > 0, a factor,", d.rate > 0 or not d.step
    a, rows, n = closed(d, d.rho), [], len(d.a.rows)
    for _ in range(n): rows, part = rows + part.rows, part @ a
    short(cleared(M(rows))[0], n, 100)
    basis, free = kernel(rows, n)  # each column has a 1 where the others have 0, so that A N = N X shows X there
    yield "an unobservable subspace", bool(free)
    x = M([(a @ basis).rows[j] for j in free])
    first = routh(1 / d.rate * x if d.step else x + d.rate * eye(len(free)), d.step)
    yield "a mode in it that is too slow", first is None or any(x * y < 0 for x, y in itertools.pairwise(first))

def kernel(rows, n):
    """The columns that span {v: rows v = 0}, and the places of their ones."""
    pivots = []
    for j in range(n):
        top, rest = len(pivots), sorted(rows[len(pivots) :], key=lambda row: not row[j])
        if not (rest and rest[0][j]): continue
        pivots, lead = [*pivots, j], [Fraction(x) / rest[0][j] for x in rest[0]]
        rows = [row if row is lead else [x - row[j] * y for x, y in zip(row, lead)] for row in [*rows[:top], lead, *rest[1:]]]
    free = [j for j in range(n) if j not in pivots]
    return M([-rows[pivots.index(i)][j] if i in pivots else int(i == j) for j in free] for i in range(n)), free

@theorem("gain-floor", BOX.replace("gain=n,p ", "") + "points=N,r weights=R rate= level=", "every gain L with which all errors decay "
         "faster than exp(-{rate} t) at each of the constant parameters {points} has |L| > {level}", NONE)
def gain_floor(d):
    n, alpha, m, d.gain, d.inner = len(d.a.rows), 0, 0 * d.output, 0 * d.output.T, M([])
    yield "one output and n weights a point", len(d.output.rows) == 1 and len(d.weights) == n * len(d.points.rows)
    yield "weights >= 0, not all zero, and level >= 0", min(d.weights) >= 0 < max(d.weights) and d.level >= 0
    for c, rho in enumerate(d.points.rows):
        yield f"the box containing point {c}", contained(d, rho)
        f, b = closed(d, rho) + d.rate * eye(n), eye(n)
        for k, weight in enumerate(d.weights[c * n : (c + 1) * n], 1):  # det(s I - f + L C) = s^n + sum (x + C b L) s^{n-k}
            x = -Fraction(trace(f @ b)) / k
            alpha, m, b = alpha - weight * x, m + weight * (d.output @ b), f @ b + x * eye(n)
    yield "level |m| <= alpha, that is positive", alpha > 0 and d.level**2 * trace(m @ m.T) <= alpha**2

@theorem("switching-instability", BOX + "points=N,r durations=N repeats:int step:int scale:ints", "with the gain L = {gain} some errors grow "
         "exponentially when the parameters take the values {points} for the times {durations}, again and again", SWITCHED)
def switching_instability(d):
    n, product, d.inner = len(d.a.rows), None, M([])
    yield "step 0 or 1, 1 to 256 repeats", d.step in (0, 1) and 1 <= d.repeats <= 256
    powers = [Fraction(2) ** max(-2000, min(x, 2000)) for x in d.scale or [0] * n]  # coordinates of less rounding
    for k, (rho, time) in enumerate(zip(d.points.rows, d.durations, strict=True)):
        f = M([x * powers[j] / powers[i] for j, x in enumerate(row)] for i, row in enumerate(closed(d, rho).rows))
        yield f"the box containing point {k}", contained(d, rho)
        yield f"time {k} > 0, in steps whole and up to 256,", time > 0 and (not d.step or time == int(time) <= 256)
        yield f"|F| t <= 2^30 at point {k}", time * max(sum(map(abs, row)) for row in f.rows) <= 2**30
        part = power(ball(f), int(time)) if d.step else exponential(f, time)
        product = part if product is None else times(part, product)
    raised = power(product, d.repeats)
    size = abs(sum(row[i] for i, row in enumerate(raised[0]))) - n * raised[1]  # of the trace, at least
    yield "|tr M^repeats| > n, the number of states, with every rounding bounded", size > n << UNIT
    d.margins["growth_rate"] = (math.log(size) - UNIT * math.log(2) - math.log(n)) / (d.repeats * real(sum(d.durations)))

UNIT = 1024  # a ball is (rows, radius): all matrices within the radius of rows in the largest row sum, both times 2^-UNIT

def ball(f): return [[math.floor(x * 2**UNIT) for x in row] for row in f.rows], len(f.rows)
def norm(rows): return max(sum(map(abs, row)) for row in rows)
def power(x, k): return x if k == 1 else times(power(x, k - 1), x) if k % 2 else power(times(x, x), k // 2)

def times(x, y):
    """|X Y - x y| <= |x| r_y + r_x |y| + r_x r_y, and less than 2^-UNIT an entry for rounding down."""
    if max(norm(x[0]), norm(y[0])).bit_length() > 8 * UNIT: raise Refused("a product beyond 2^7000")
    rows = [[sum(map(mul, row, column)) >> UNIT for column in zip(*y[0])] for row in x[0]]
    return rows, (norm(x[0]) * y[1] + x[1] * norm(y[0]) + x[1] * y[1] >> UNIT) + 1 + len(rows)

def exponential(f, time):
    """e^{f time}: Taylor's series at |f time| / 2^s <= 1/2, whose rest is below its last term, and s squarings."""
    n, s = len(f.rows), max(0, math.ceil(time * norm(f.rows)).bit_length() + 1)
    x, term, k = ball(time / 2**s * f), ball(eye(n)), 1
    rows, radius = term
    while norm(term[0]) > n:
        term, k = times(term, x), k + 1
        term = [[entry // (k - 1) for entry in row] for row in term[0]], term[1] + n
        rows, radius = [[*map(sum, zip(*pair))] for pair in zip(rows, term[0])], radius + term[1]
    total = rows, radius + norm(term[0]) + term[1]
    for _ in range(s): total = times(total, total)
    return total

HELD = ("e' = (a + sum_k rho_k b_k c_k) e - (gain + sum_k rho_k b_k inner_k) output e(t_k), t_k <= t < t_k+1, is the error of the "
        "observer: that of the continuous plant, with the innovation held; 0 < t_k+1 - t_k <= delta, intervals may vary", *MODEL[1:])
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
    yield "delta > 0, rate >= 0", d.delta > 0 and d.rate >= 0
    yield "whole blocks Q_i", len(rows) % size == 0 and len(rows[0]) == size
    short(cleared(d.tube)[0], 3 * size, len(rows) << len({*d.tied} or d.lower))
    q = [block([d.start, zeros(n, size - n)], [zeros(size - n, size)]), *(M(rows[i : i + size]) for i in range(0, len(rows), size))]
    yield from [("Q_0 > 0", d.start)] + [(f"Q_{i} < Q_0 for e", d.start - M(row[:n] for row in x.rows[:n])) for i, x in enumerate(q) if i]
    for i, x in enumerate(q):
        grows = i * (x - q[i - 1]) + (len(q) - 1 - i) * (q[min(i + 1, len(q) - 1)] - x) - 2 * d.rate * d.delta * x
        moved = lambda rho, f: d.delta * sym(block([f], [d.output @ f]) @ x)
        found = vertices(d, lambda rho: grows - moved(rho, block([closed(d, rho), injected(d, rho)])))
        yield from ((f"the growth of Q_{i} {at(rho)}", m) for rho, m in found)
    d.margins["decay_rate"] = d.rate

@theorem("regional", FULL + "rate= faces=f,n inner_lower=f inner_upper=f outer_lower=f outer_upper=f level= radius=", "every error with "
         "e(0)'P e(0) <= {level}, P = {p}, so every one with |e(0)| <= {radius}, decays at least like exp(-{rate} t)" + BOXED, (*MODEL[:2],
         "rho stays within the stored bounds while H x and H xhat stay in [{outer_lower}, {outer_upper}], H = {faces} (bounds: {origin!r})",
         "H x stays in [{inner_lower}, {inner_upper}] at all times"))
def regional(d):
    yield from THEOREMS["corners"].builder(d)
    yield "level > 0, radius >= 0", d.level > 0 and d.radius >= 0
    for j, h in enumerate(d.faces.rows):
        room = min(d.outer_upper[j] - d.inner_upper[j], d.inner_lower[j] - d.outer_lower[j])
        yield from ((f"ordered inner bounds at face {j}", d.inner_lower[j] <= d.inner_upper[j]), (f"room at face {j}", room > 0))
        yield f"the region within face {j}", block([d.p, M([h]).T], [M([h]), M([[room**2 / d.level]])])
    yield "the ball within the region", d.level * eye(len(d.p.rows)) - d.radius**2 * d.p
    d.margins["radius"] = d.radius

@theorem("mismatch", FULL + "alpha= beta= gamma= disturbance=n,m size= noise_size= weight=s,n bound=", "|weight e(t)|^2 <= {bound}^2 (1 + "
         "exp(-{alpha} t) (e(0)'P e(0) - 1)), P = {p}; so in the end |weight e| <= {bound}, weight = {weight}," + BOXED, (*MODEL, "beside "
         "F(rho) e the error is moved by disturbance d(t) - (gain + sum_k rho_k b_k inner_k) v(t), disturbance = {disturbance}, |d| <= {size}: "
         "what the model lacks, and |v| <= {noise_size}: the measurement noise, at all times"))
def mismatch(d):
    weights = [d.beta] * len(d.disturbance.rows[0]) + [d.gamma] * len(d.output.rows)
    yield from (("P > 0", d.p), ("alpha, bound > 0", d.alpha > 0 and d.bound > 0))
    yield "no multipliers beside inner", not (any(d.taus) and d.inner.rows)
    yield from decrease(d, d.p, d.alpha * d.p, d.taus, more=lambda rho: (block([d.disturbance, -1 * injected(d, rho)]), weights))
    yield "beta size^2 + gamma noise_size^2 <= alpha", d.beta * d.size**2 + d.gamma * d.noise_size**2 <= d.alpha
    yield "|weight e|^2 <= bound^2 e'P e", block([d.p, d.weight.T], [d.weight, d.bound**2 * eye(len(d.weight.rows))])
    d.margins["bound"] = d.bound

if __name__ == "__main__": sys.exit(main(sys.argv[1:]))
