"""Decides certificates (jaxobs-cert/1) in exact arithmetic; needs nothing but Python. Usage: python checker.py FILE...

A float is a dyadic rational, so nothing is rounded. A builder makes its matrices from the stored gain and bounds and yields
(what, matrix that must be positive definite) or (what, truth). "Not certified" never means "unstable".
"""

import hashlib
import itertools
import json
import math
import sys
from fractions import Fraction
from operator import mul
from pathlib import Path
from types import SimpleNamespace

MOST = {"r": 64, "N": 256, "R": 50_000}  # of the dimensions named in the fields below; 12 of any other
MOST_WORK, MOST_BYTES, SPENT, THEOREMS = 1e13, 2**24, [0.0], {}  # a minute; of a file; work done so far on one certificate
ERRORS = (ArithmeticError, LookupError, RecursionError, TypeError, ValueError, AttributeError)  # of a malformed certificate

class Refused(Exception):
    """Why the claim does not follow from what is stored."""

class M:
    """A matrix of rationals."""
    def __init__(self, rows): self.rows = [list(row) for row in rows]
    def __add__(self, other): return M(map(sum, zip(*pair, strict=True)) for pair in zip(self.rows, other.rows, strict=True))
    def __sub__(self, other): return self + -1 * other
    def __rmul__(self, factor): return M([factor * x for x in row] for row in self.rows)
    def __matmul__(self, other): return M([sum(map(mul, row, column)) for column in other.T.rows] for row in self.rows)
    def __getitem__(self, j): return M([row[j]] for row in self.rows)  # a column
    T = property(lambda self: M(zip(*self.rows, strict=True)))

def diag(x): return M([entry if i == j else 0 for j in range(len(x))] for i, entry in enumerate(x))
def eye(n): return diag([1] * n)
def zeros(rows, columns): return M([0] * columns for _ in range(rows))
def block(*lines): return M(sum(rows, []) for line in lines for rows in zip(*(m.rows for m in line), strict=True))
def sym(x): return x + x.T
def trace(x): return sum(row[i] for i, row in enumerate(x.rows))

def cleared(m):
    """The matrix times a positive integer, in integers, and that integer."""
    common = math.lcm(*(x.denominator for row in m.rows for x in row))
    return [[int(x * common) for x in row] for row in m.rows], common

def short(rows, size, count=1):  # a hostile file must not keep the check busy
    SPENT[0] += count * size**3 * (size * max((abs(x).bit_length() for row in rows for x in row), default=0) + 2e3) ** 1.6
    if SPENT[0] > MOST_WORK: raise Refused("numbers of so many digits would take minutes")

def pivots(m, semi=False):
    """The leading minors of a symmetric matrix times positive numbers, up to the first that is not positive: fraction-free
    elimination (Bareiss). semi: rows that have become zero are passed over; what is left decides positive semidefiniteness."""
    a, found = cleared(m)[0], [1]
    short(a, len(a))
    for k, row in enumerate(a):
        if semi and not any(row[k:]): continue
        for i in range(k + 1, len(a) if row[k] > 0 else 0):
            for j in range(i, len(a)): a[i][j] = (a[i][j] * row[k] - row[i] * row[j]) // found[-1]
        found.append(row[k])
        if row[k] <= 0: break
    return found

def definite(m, semi=False): return m.rows == m.T.rows and pivots(m, semi)[-1] > 0

def vertices(d, build, taus=()):
    """(rho, build(rho) times a positive integer) at the vertices of the box; build is affine in rho. Channels of equal `tied`
    are one parameter; those with tau > 0 are not enumerated, their rho is 0."""
    names = [None if taus and taus[k] else name for k, name in enumerate(d.tied or range(len(d.lower)))]
    own = [name for name in dict.fromkeys(names) if name is not None]
    start = build([0] * len(names))
    slopes = [build([int(name == one) for name in names]) - start for one in own]
    ends = [sorted({d.lower[names.index(one)], d.upper[names.index(one)]}) for one in own]
    stack = [start, *(x * slope for slope, xs in zip(slopes, ends) for x in xs)]
    rows, n = cleared(M(row for m in stack for row in m.rows))[0], len(start.rows)
    short(rows, n, math.prod(map(len, ends)))
    parts = (M(rows[i : i + n]) for i in range(0, len(rows), n))
    first, choices = next(parts), [[(x, next(parts)) for x in xs] for xs in ends]
    def walk(chosen, m, rest):
        if not rest: yield [chosen[own.index(name)] if name is not None else 0 for name in names], m
        for x, part in rest[0] if rest else []: yield from walk([*chosen, x], m + part, rest[1:])
    yield from walk([], first, choices)

def at(rho): return f"at the corner {[*map(real, rho)]}"

def seen(d): return d.c - d.inner @ d.output if d.inner.rows else d.c

def closed(d, rho):
    """F(rho) = a + sum_k rho_k b_k (c_k - inner_k output) - gain output."""
    return sum((x * (d.b[k] @ M([seen(d).rows[k]])) for k, x in enumerate(rho) if x), d.a - d.gain @ d.output)

def injected(d, rho):
    """G(rho) = gain + b diag(rho) inner: how measurement noise enters."""
    return d.gain + d.b @ diag(rho) @ d.inner if d.inner.rows else d.gain

def decrease(d, p, load, taus=(), factor=None, more=None):
    """F'P + P F + load < 0 (factor: F'P F < factor^2 P) at all vertices, for F + left Delta right, |Delta| <= 1, by the
    S-procedure with d.tau; channels with tau_k > 0 by (w - l v)(u v - w) >= 0 in place of corners. more(rho): (G, weights) of
    further inputs e' = F e + G w, that shall have V' <= w' diag(weights) w."""
    b, cross, weights, n = zeros(len(p.rows), 0), zeros(len(p.rows), 0), [], len(p.rows)
    for k in (k for k, tau in enumerate(taus) if tau):
        v = M([seen(d).rows[k]]).T
        load, weights = load - taus[k] * d.lower[k] * d.upper[k] * (v @ v.T), [*weights, taus[k]]
        b, cross = block([b, d.b[k]]), block([cross, taus[k] * (d.lower[k] + d.upper[k]) / 2 * v])
    if d.left.rows:
        load, b, width = load + d.tau * (d.right.T @ d.right), block([b, d.left]), len(d.left.rows[0])
        cross, weights = block([cross, zeros(n, width)]), weights + [d.tau] * width
    def whole(rho):
        f, (g, weight) = closed(d, rho), more(rho) if more else (zeros(n, 0), [])
        inputs, beside, w = block([b, g]), block([cross, zeros(n, len(weight))]), diag(weights + weight)
        if factor is None:
            return block([-1 * (sym(p @ f) + load), -1 * (p @ inputs + beside)], [-1 * (p @ inputs + beside).T, w])
        return block([factor**2 * p - load, -1 * beside, (p @ f).T], [-1 * beside.T, w, (p @ inputs).T], [p @ f, p @ inputs, p])
    yield "the multipliers >= 0", all(tau >= 0 for tau in [*taus, d.tau])
    yield from ((f"the decrease of e'P e {at(rho)}", m) for rho, m in vertices(d, whole, taus))

# Fields: matrices (p=n,n), vectors (tau=r), numbers (rate=), which may be left empty if marked ?; integers, text.
BOX = "a=n,n b=n,r c=r,n output=p,n gain=n,p lower=r upper=r tied:ints "
FULL = BOX + "inner=r,p? left=n,u? right=v,n? tau= taus=r? origin:str p=n,n "
NOISY = FULL + "rate= q=n,n? taus_q=r? weight=s,n process=n,m noise=p,k level= "
MODEL = ("{moves} = F(rho) e is the error of the observer, F = a + sum_k rho_k b_k (c_k - inner_k output) - gain output (+ "
         "left Delta right, |Delta| <= 1, if given), rho_k equal for equal numbers in tied = {tied}", "gains are real numbers, "
         "carried out without rounding", "rho stays within the stored bounds at all times (bounds: {origin!r})")
BOXED = " for all rho in [{lower}, {upper}] with the gain L = {gain}"

def theorem(name, fields, claim, assumptions=MODEL):
    """Registers the builder that follows."""
    kinds = [one.replace("=", ":=").split(":", 1) for one in fields.split()]
    entry = THEOREMS.setdefault(name, SimpleNamespace(kinds=kinds, claim=claim, assumptions=assumptions))
    return lambda builder: vars(entry).setdefault("builder", builder)

@theorem("corners", FULL + "rate=", "the error decays at least like exp(-{rate} t)" + BOXED)
def corners(d):
    yield from (("P > 0", d.p), ("rate >= 0", d.rate >= 0))
    yield from decrease(d, d.p, 2 * d.rate * d.p, d.taus)
    d.margins["decay_rate"] = d.rate

@theorem("step-corners", FULL + "factor=", "the error decays at least like {factor}^k" + BOXED)
def step_corners(d):
    yield from (("P > 0", d.p), ("0 < factor <= 1", 0 < d.factor <= 1))
    yield from decrease(d, d.p, 0 * d.p, d.taus, factor=d.factor)
    d.margins["decay_factor"] = d.factor

NOISE = "for inputs process w - (gain + b diag(rho) inner) noise v "

@theorem("h2", NOISY + "x=n,n?", "the error decays at least like exp(-{rate} t), and " + NOISE + "of unit white noise the "
         "mean over time of |weight e|^2 is at most {level}" + BOXED, (*MODEL, "where q = {q} is empty: rho(t) does not "
         "depend on the noise"))
def h2(d):
    yield from corners(d)
    inputs = lambda rho: block([d.process, -1 * (injected(d, rho) @ d.noise)])
    if d.q.rows:  # F'Q + Q F + E'E < 0, tr G'Q G <= level
        yield from (("Q > 0", d.q), ("no multipliers beside inner", not (any(d.taus_q) and d.inner.rows)))
        yield from decrease(d, d.q, d.weight.T @ d.weight, d.taus_q)
        for rho, _ in vertices(d, lambda rho: d.q) if d.inner.rows else [((), d.q)]:
            yield f"tr G'Q G <= level {at(rho)}", trace(inputs(rho).T @ d.q @ inputs(rho)) <= d.level
    else:  # F X + X F' + G G' < 0, tr E X E' <= level
        yield from (("X > 0", d.x), ("tr E X E' <= level", trace(d.weight @ d.x @ d.weight.T) <= d.level))
        yield "Q, where there is a Delta", not d.left.rows
        whole = lambda rho: block([-1 * sym(closed(d, rho) @ d.x), inputs(rho)], [inputs(rho).T, eye(len(inputs(rho).rows[0]))])
        yield from ((f"F X + X F' + G G' < 0 {at(rho)}", m) for rho, m in vertices(d, whole))

@theorem("l2", NOISY, "the error decays at least like exp(-{rate} t), and " + NOISE + "|weight e| <= {level} |(w, v)| in L2 "
         "from e(0) = 0" + BOXED)
def l2(d):
    yield from corners(d)
    yield from (("Q > 0", d.q), ("level >= 0", d.level >= 0))
    yield "no multipliers beside inner", not (any(d.taus_q) and d.inner.rows)
    inputs = lambda rho: block([d.process, -1 * (injected(d, rho) @ d.noise)])
    more = lambda rho: (inputs(rho), [d.level**2] * len(inputs(rho).rows[0]))
    yield from decrease(d, d.q, d.weight.T @ d.weight, d.taus_q, more=more)

def real(x):
    """For reading, never for deciding."""
    try: return float(x)
    except OverflowError: return math.inf if x > 0 else -math.inf

def decoded(value, dims, sizes):
    """The floats of a field, nested as its dimensions say; of a text with more digits, the float that is nearest."""
    if not dims: return float.fromhex(value)
    if type(value) is not list or sizes.setdefault(dims[0], len(value)) != len(value):
        raise Refused("its size does not fit the others")
    most = MOST.get(dims[0], 12)
    if not (dims[0] != "r") <= len(value) <= most: raise Refused(f"{len(value)} entries, expected 1 to {most}")
    return tuple(decoded(x, dims[1:], sizes) for x in value)

def field(value, kind, sizes):
    """What is shown of a field, and what is computed with."""
    if kind in ("int", "str", "ints"):
        if type(value) is not {"int": int, "str": str, "ints": list}[kind] or (kind == "ints" and {*map(type, value)} - {int}):
            raise TypeError(f"given {value!r:.50}, expected {kind}")
        return (tuple(value) if kind == "ints" else value), value
    dims = kind.strip("=?").split(",") if kind.strip("=?") else []
    shown = () if kind[-1] == "?" and value == [] else decoded(value, dims, sizes)
    if len(dims) == 2: return shown, M(map(Fraction, row) for row in shown)
    return shown, [*map(Fraction, shown)] if dims else Fraction(shown)

def parsed(kinds, data):
    shown, d, sizes = {}, {"lower": [], "upper": [], "tied": []}, {}
    for name, kind in kinds:
        try: shown[name], d[name] = field(data[name], kind, sizes)
        except (*ERRORS, Refused) as error: raise Refused(f"{name}: {error!s:.80}") from error
    tied = d["tied"] or [*range(len(d["lower"]))]
    if len(tied) != len(d["lower"]): raise Refused(f"tied: {len(tied)} numbers for {len(d['lower'])} channels")
    bounds = [*zip(d["lower"], d["upper"])]
    if any(not (lo <= hi and (lo, hi) == bounds[tied.index(name)]) for (lo, hi), name in zip(bounds, tied)):
        raise Refused("lower <= upper, the same for tied channels, fails")
    return shown, SimpleNamespace(margins={}, **d)

def statement(name, shown):
    """What is certified, with every number in full, and what is taken for granted."""
    entry, shown = THEOREMS[name], {"moves": "e+" if name.startswith("step") or shown.get("step") else "e'", **shown}
    return {"claim": entry.claim.format(**shown), "assumptions": [text.format(**shown) for text in entry.assumptions]}

def digest(data):
    body = {key: value for key, value in data.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

def check(data):
    """{"holds", "why", "margins", "claim", "assumptions"} for a certificate as JSON gives it."""
    found, d, SPENT[0] = {"holds": False, "claim": "", "assumptions": []}, SimpleNamespace(margins={}), 0.0
    try:
        if type(data) is not dict or data.get("format") != "jaxobs-cert/1": raise Refused("the format is not jaxobs-cert/1")
        if data["theorem"] not in THEOREMS: raise Refused(f"theorem {data['theorem']!r:.40} is none of {', '.join(THEOREMS)}")
        if data["sha256"] != digest(data): raise Refused("the contents do not match their SHA-256")
        shown, d = parsed(THEOREMS[data["theorem"]].kinds, data)
        found |= statement(data["theorem"], shown)
        if any(data[key] != found[key] for key in ("claim", "assumptions")): raise Refused("the text is not the theorem's")
        for what, truth in THEOREMS[data["theorem"]].builder(d):
            if not (truth if isinstance(truth, bool) else definite(truth)): raise Refused(f"{what} fails")
        found |= {"holds": True, "why": "holds for the stored model and bounds, in exact arithmetic"}
    except Refused as error: found["why"] = f"not certified: {error}"
    except ERRORS as error: found["why"] = f"not certified: malformed, {type(error).__name__}: {error!s:.80}"
    return found | {"margins": {key: real(value) for key, value in d.margins.items()}}

def once(pairs): return dict(pairs) if len(dict(pairs)) == len(pairs) else None  # a key given twice can be read in two ways
def main(paths):
    """Prints the verdicts; 0 if all hold, 1 if one does not, 2 if a file cannot be read."""
    code = 0
    for path in paths:
        try:
            if Path(path).stat().st_size > MOST_BYTES: raise ValueError(f"more than {MOST_BYTES} bytes")
            one = check(json.loads(Path(path).read_text(encoding="utf-8"), object_pairs_hook=once))
            print(f"{path}: {one['why']}", f"claim: {one['claim']}", *map("assumes: {}".format, one["assumptions"]), sep="\n  ")
            code = max(code, int(not one["holds"]))
        except (OSError, ValueError, RecursionError) as error:
            print(f"{path}: no certificate: {error!s:.200}")
            code = 2
    return code

if __name__ == "__main__": sys.exit(main(sys.argv[1:]) if sys.argv[1:] else __doc__)
