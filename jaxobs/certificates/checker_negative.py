"""Decides the negative theorems of jaxobs-cert/1, as checker.py does, which lies beside it: gains that fail, gains that cannot
exist, floors that no gain and no filter beats. Usage: python checker_negative.py FILE...
"""

try: from jaxobs.certificates.checker import *  # its matrices, its reading of files, its theorems
except ImportError: from checker import *

NONE = ("a statement on the stored matrices; another kind of proof may exist, and the observer may converge",)

@theorem("no-gain", BOX.replace("gain=n,p", "gain=n,p?") + "points=N,r multipliers=R,n rate= step:int radius= t=", "no P > 0 "
         "makes sqrt(e'P e) decay faster than at the rate {rate} (step = {step}: factor) at all parameters {points}, with L = "
         "{gain}; where that is empty, with no L at all (radius {radius} > 0: no L of |L| <= radius); for a single point: no "
         "such L makes all errors decay like that", NONE)
def no_gain(d):
    n, rows, total, g = len(d.a.rows), d.multipliers.rows, 0 * d.a, 0 * d.output.T
    any_gain, d.inner, d.gain = not d.gain.rows, M([]), d.gain if d.gain.rows else g
    yield "one multiplier a point, step 0 or 1", len(rows) == n * len(d.points.rows) and d.step in (0, 1)
    for c, rho in enumerate(d.points.rows):
        f, x = closed(d, rho), M(rows[c * n : (c + 1) * n])
        yield f"the box containing point {c}", contained(d, rho)
        yield f"X >= 0 at point {c}", definite(x, semi=True)
        total, g = total + (f @ x @ f.T - d.rate**2 * x if d.step else sym(f @ x) + 2 * d.rate * x), g + x @ d.output.T
        short(cleared(total)[0], n)  # long sums take time too
    yield "some X not zero", any(map(any, rows))
    if any_gain and d.radius > 0:
        yield "t > 0, continuous time", d.t > 0 and not d.step
        total = block([total - d.t * d.radius**2 * eye(n), g], [g.T, d.t * eye(len(d.output.rows))])
    elif any_gain: yield "sum X output' = 0", not any(map(any, g.rows))
    yield "sum F X + X F' + 2 rate X >= 0", definite(total, semi=True)

def contained(d, rho):
    tied = d.tied or list(range(len(rho)))
    return all(lo <= x <= hi and x == rho[tied.index(t)] for lo, x, hi, t in zip(d.lower, rho, d.upper, tied))

@theorem("kalman-floor", BOX.replace("gain=n,p ", "") + "rho=r weight=s,n process=n,m noise=p,k s=n,n level=", "no linear "
         "filter that is unbiased in the end from every initial state has, at the constant rho = {rho}, a smaller mean over "
         "time of |weight e|^2 than {level}", NONE)
def kalman_floor(d):
    d.gain, d.inner, so, v = 0 * d.output.T, M([]), d.s @ d.output.T, d.noise @ d.noise.T
    yield "the box containing rho", contained(d, d.rho)
    yield from (("S = S'", d.s.rows == d.s.T.rows), ("V > 0", v))
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
    """The first column of Routh's scheme for the eigenvalues of f (step: about the unit circle): each change of sign is one
    outside. None where it breaks off, which it never does when all lie inside."""
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
    """How many eigenvalues have Re s > 0 (|z| > 1), by Routh's scheme; where it breaks off, at least: for f moved inward."""
    short(cleared(f)[0], len(f.rows), 100)
    for h in (0, Fraction(1, 2**40), Fraction(1, 2**80)):
        first = routh(1 / (1 + Fraction(h)) * f if step else f - h * eye(len(f.rows)), step)
        if first is not None: return sum(x * y < 0 for x, y in itertools.pairwise(first))
    return 0

@theorem("undetectable", BOX.replace("gain=n,p ", "") + "rho=r rate= step:int", "at the constant rho = {rho} the outputs do "
         "not see a mode, which no gain moves and which decays no faster than at the rate {rate} (step = {step}: factor)", NONE)
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

@theorem("gain-floor", BOX.replace("gain=n,p ", "") + "points=N,r weights=R rate= level=", "every gain L with which all errors "
         "decay faster than exp(-{rate} t) at each of the constant parameters {points} has |L| > {level}", NONE)
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

@theorem("switching-instability", BOX + "points=N,r durations=N repeats:int step:int scale:ints", "with the gain L = "
         "{gain} some errors grow exponentially when the parameters take the values {points} for the times {durations}, again "
         "and again", SWITCHED)
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

if __name__ == "__main__": sys.exit(main(sys.argv[1:]) if sys.argv[1:] else __doc__)
