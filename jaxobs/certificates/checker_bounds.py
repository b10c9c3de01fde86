"""Re-checks the bounds that travel inside a certificate; needs nothing but Python. Usage: python checker_bounds.py FILE...

The file brings the Jacobian J(x, u) of a model as formulas, a box of x and u, and for each parameter rho of the certificate its
formula and a bisection of the box. Decided, with a, b, c, lower, upper of the certificate and for all x, u in the box:

    J = a + sum_k rho_k b_k c_k',  formula by formula in fractions,   and   lower_k <= rho_k <= upper_k.

That the printed formulas are the Jacobian of your model is for you to compare. Elementary functions come from their series.
"""

import hashlib
import json
import math
import sys
from fractions import Fraction as Q
from functools import lru_cache, reduce
from itertools import pairwise
from operator import or_
from pathlib import Path
from typing import Any, NamedTuple

MOST_BYTES, MOST_NODES, MOST_VARIABLES, MOST_EFFORT = 2**22, 5000, 24, 500_000  # the last is about a minute
ERRORS = (ArithmeticError, LookupError, RecursionError, TypeError, ValueError, AttributeError)  # of a malformed file
INF, CAP, P = float("inf"), 2000, 160
ONE, ERROR = 1 << P, 1 << 62  # of a series, in units of 2^-P: its roundings, a few each, those of k pi, k log 2, |k| < 2^30

class Refused(Exception): """Why the bounds do not follow from what the file says."""

def near(x): return float(x) if abs(x) <= sys.float_info.max else INF if x > 0 else -INF  # for reading
def exact(x): return repr(near(x)) if near(x) == x else str(x)
def fixed(x): return (x.numerator << P) // x.denominator
def outward(low, high): return Interval(-up(-low), up(high))

def series(term, ratio, value=0, i=1):
    """The sum of integer terms, the i-th being p / q = ratio(i) times the one before, until they vanish."""
    while abs(term) > 1:
        p, q = ratio(i)
        value, i, term = value + term, i + 1, term * p // q
    return value

def artanh(t):  # |t| <= 1/2: sum t^(2i+1) / (2i+1)
    return series(t, lambda i: ((t * t >> P) * (2 * i - 1), (2 * i + 1) << P))

def arctan(t):  # |t| <= 1, Euler: sum 2^2i i!^2 / (2i+1)! t^(2i+1) / (1+t^2)^(i+1)
    y = (ONE << P) // (ONE + (t * t >> P))
    return series(t * y >> P, lambda i: (2 * i * (ONE - y), (2 * i + 1) << P))
LN2, PI = 2 * artanh(ONE // 3), 4 * arctan(ONE)

@lru_cache(1 << 14)
def at(name, x):
    """(low, high) around the function at one number."""
    if x == (name == "log"): return (Q(name in ("exp", "cos")),) * 2
    size = x.numerator.bit_length() - x.denominator.bit_length()
    if name == "sqrt":
        unit = Q(2) ** ((size - P) // 2)
        root = math.isqrt(math.floor(x / unit**2))
        return root * unit, (root + (root * root * unit**2 != x)) * unit
    if name == "exp":
        if abs(x) > 1000: return (Q(2) ** 1442, INF) if x > 0 else (Q(0), Q(1, 1 << 1442))
        k, rest = divmod(fixed(x), LN2)
        value = series(ONE, lambda i: (rest, i << P))
        return Q(value - ERROR, ONE) * Q(2) ** k, Q(value + ERROR, ONE) * Q(2) ** k
    if name == "tanh": return tuple(1 - (Q(0) if e == INF else 2 / (e + 1)) for e in at("exp", 2 * x))
    if name == "erf" and abs(x) > 7: return (1 - Q(1, 1 << 70), Q(1)) if x > 0 else (-Q(1), Q(1, 1 << 70) - 1)
    if name in ("sin", "cos"):
        t = (fixed(x) - (PI >> 1 if name == "sin" else 0)) % (2 * PI) - PI  # and cos(t + pi) = -cos(t)
        value = -series(ONE, lambda i: (-t * t, (2 * i - 1) * 2 * i << 2 * P))
    elif name == "log": value = 2 * artanh(fixed((x - Q(2) ** size) / (x + Q(2) ** size))) + size * LN2
    elif name == "atan": value = arctan(fixed(x)) if abs(x) <= 1 else (PI if x > 0 else -PI) // 2 - arctan(fixed(1 / x))
    else:  # erf: 2 / sqrt(pi) exp(-x^2) sum 2^i x^(2i+1) / (1 3 ... (2i+1))
        t, bell = fixed(x), sum(at("exp", -x * x)) / 2  # a fraction: the sum is up to 2^71
        value = 2 * math.floor(bell * series(t, lambda i: (2 * t * t, (2 * i + 1) << 2 * P))) * ONE // math.isqrt(PI << P)
    return Q(value - ERROR, ONE), Q(value + ERROR, ONE)

def up(x):
    """A number of 80 bits that is >= x; infinite beyond 2^2000."""
    if type(x) is float or x == 0: return x  # the only floats are infinite
    size = x.numerator.bit_length() - x.denominator.bit_length()
    if abs(size) > CAP: return (INF if x > 0 else -(Q(2) ** CAP)) if size > 0 else Q(x > 0, 1 << CAP)
    more, less = max(80 - size, 0), max(size - 80, 0)
    return Q(-((-x.numerator << more) // (x.denominator << less)) << less, 1 << more)

def times(x, y):
    if float not in (type(x), type(y)): return x * y
    return Q(0) if 0 in (x, y) else INF if (x > 0) == (y > 0) else -INF  # infinity is no value: 0 times it is 0

RANGE = {"exp": (Q(0), INF), "log": (-INF, INF), "sqrt": (Q(0), INF), "atan": (-Q(2), Q(2))}  # and all of these increase
RANGE |= dict.fromkeys(("tanh", "erf"), (-Q(1), Q(1)))

class Interval(NamedTuple):
    low: Q | float
    high: Q | float
    def __mul__(self, other): return outward(min(ends := [times(x, y) for x in self for y in other]), max(ends))
    def __pow__(self, n):  # None for a negative power of an interval with 0
        if n < 0 and self.low <= 0 <= self.high: return None
        if n < 0: return outward(*(Q(0) if type(x) is float else 1 / x for x in self[::-1])) ** -n
        low, high = ((x if n % 2 else INF) if type(x) is float else x**n for x in self)
        return outward(low, high) if n % 2 or self.low >= 0 else outward(high if self.high <= 0 else Q(0), max(low, high))

    def apply(self, name):
        """An enclosure of the function's values; None where it is not defined throughout."""
        low, high = self
        if name in ("sin", "cos"):
            if max(-low, high) > 1 << 30 or high - low > 7: return Interval(-Q(1), Q(1))
            quarter, ends = (PI >> 1 if name == "sin" else 0), at(name, low) + at(name, high)
            tops = range(-((ERROR + quarter - fixed(low)) // PI), (fixed(high) - quarter + ERROR) // PI + 1)  # k: k pi within
            low = -Q(1) if any(k % 2 for k in tops) else max(-Q(1), min(ends))
            return outward(low, Q(1) if any(k % 2 == 0 for k in tops) else min(Q(1), max(ends)))
        if name in ("log", "sqrt") and (low < 0 or (low == 0 and name == "log")): return None
        least, most = RANGE[name]
        low = least if low == -INF else max(least, at(name, low)[0])
        return outward(low, most if high == INF else min(most, at(name, high)[1]))

def total(constant, parts) -> Any:
    """constant + the sum of coefficient times interval; None if one of these is."""
    low = high = constant
    for k, a in parts:
        if a is None: return None
        x, y = outward(*(times(k, end) for end in (a if k > 0 else a[::-1])))
        low, high = (-INF if -INF in (low, x) else low + x), (INF if INF in (high, y) else high + y)
    return outward(low, high)

WRITTEN = {"x": "{}", "^": "({})^{}", "*": "({})*({})", "min": "min({}, {})", "<=": "({} <= 0 ? {} : {})"}
WRITTEN |= {name: name + "({})" for name in ("sin", "cos", *RANGE)}

def number(text):
    """The exact value of a fraction "p/q" or a hex float."""
    value = Q(text) if "/" in text and len(text) < 1500 else Q(float.fromhex(text))
    return value if abs(value) <= sys.float_info.max else float.fromhex("0x1p9999")  # which raises OverflowError

def integer(value, low, high):
    if type(value) is not int or not low <= value < high: raise Refused(f"an integer from {low} to {high - 1}, {value!r:.20},")
    return value

class Formulas:
    """A node is (name, forms..., [integer]); a form, (constant, (node, coefficient), ...), is a sum over earlier nodes."""
    def __init__(self, nodes, variables):
        self.nodes, self.text, self.lines, self.below, self.left = [], [], [], [], MOST_EFFORT
        if len(nodes) > MOST_NODES: raise Refused(f"at most {MOST_NODES} nodes")
        for i, (name, *args) in enumerate(nodes):
            if name not in WRITTEN or len(args) != WRITTEN[name].count("{}"):
                raise Refused(f"a known operation in node {i}, {name!r:.20} of {len(args)} arguments,")
            last = [integer(args.pop(), *((0, len(variables)) if name == "x" else (-64, 65)))] if name in ("x", "^") else []
            forms = [*map(self.form, args)]
            text = variables[last[0]] if name == "x" else WRITTEN[name].format(*map(self.written, forms), *last)
            if len(text) > 90: self.lines.append(f"#{i} = {text}")
            self.text.append(text if len(text) <= 90 else f"#{i}")
            self.below.append(reduce(or_, map(self.under, forms), 1 << i))
            self.nodes.append((name, forms, *last))
    def form(self, given):
        terms = [(integer(j, 0, len(self.nodes)), number(k)) for j, k in given[1:]]
        if any(i >= j for (i, _), (j, _) in pairwise(terms)): raise Refused("that a sum names its nodes once, in order,")
        return number(given[0]), *terms
    def written(self, form):
        parts = [self.text[j] if k == 1 else f"{exact(k)} {self.text[j]}" for j, k in form[1:]]
        return " + ".join(parts + [exact(form[0])] * (form[0] != 0 or not parts))
    def under(self, form): return reduce(or_, (self.below[j] for j, _ in form[1:]), 0)  # the nodes below a form, as bits
    def order(self, form): return [i for i, bit in enumerate(bin(self.under(form))[:1:-1]) if bit == "1"]
    def spend(self, effort):
        self.left -= effort
        if self.left < 0: raise Refused("that the check is short (fewer leaves, shorter formulas)")

    def enclose(self, form, order, box):
        """An interval around a form on a box; None where it is not defined throughout. order: the nodes below it."""
        known, value = {}, lambda form: total(form[0], [(k, known[j]) for j, k in form[1:]])
        for i in order:
            name, forms, *last = self.nodes[i]
            self.spend(1 + sum(map(len, forms)))
            a, *more = parts = [*map(value, forms)] or [box[last[0]]]
            if name == "<=" and a: parts = more[:1] if a.high <= 0 else more[1:] if a.low > 0 else more
            if None in parts: known[i] = None
            elif name in ("x", "<="): known[i] = Interval(min(x.low for x in parts), max(x.high for x in parts))
            elif name == "min": known[i] = Interval(min(a.low, more[0].low), min(a.high, more[0].high))
            else: known[i] = a * more[0] if name == "*" else a ** last[0] if name == "^" else a.apply(name)
        return value(form)

def leaves(splits, box):
    """The boxes into which a list of splits, [variable, where] or 0 for none, cuts a box: first what is below, then above."""
    stack = [box]
    for one in splits:
        if not stack: raise Refused("that nothing follows the last leaf")
        box = stack.pop()
        if one == 0: yield box
        else:
            v, x = integer(one[0], 0, len(box)), number(one[1])
            if not box[v].low < x < box[v].high: raise Refused("that every split lies within the box it cuts")
            stack += [[*box[:v], Interval(*ends), *box[v + 1 :]] for ends in ((x, box[v].high), (box[v].low, x))]
    if stack: raise Refused("that the leaves cover the box")

def prove(data, lines):
    """The number of leaves; Refused if the bounds do not follow. Appends the formulas to `lines`."""
    body, given, count = {key: value for key, value in data.items() if key != "sha256"}, data["bounds"], 0
    names = given["variables"]
    if data["sha256"] != hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest():
        raise Refused("agreement with the SHA-256")
    if given["format"] != "jaxobs-bounds/1": raise Refused("format jaxobs-bounds/1")
    if not (len({*names}) == len(names) <= MOST_VARIABLES and all(x.isascii() and x.isidentifier() for x in names)):
        raise Refused("plain names")
    ends = [[*map(float.fromhex, pair)] for pair in zip(given["lower"], given["upper"], strict=True)]
    if not all(low <= high and low < INF and high > -INF for low, high in ends): raise Refused("lower <= upper in the box")
    s = Formulas(given["nodes"], names)
    box = [Interval(*(x if abs(x) == INF else Q(x) for x in pair)) for pair in ends]
    lines += [f"{name} in {pair}" for name, pair in zip(names, ends, strict=True)] + s.lines
    a, b, c = ([[*map(number, row)] for row in data[key]] for key in "abc")
    tied = data["tied"] or [*range(len(data["lower"]))]
    if {*map(len, b), len(c)} != {len(tied)} or len(b) != len(a): raise Refused("one column of b and row of c a parameter")
    rhos = dict(zip(dict.fromkeys(tied), ((s.form(one["rho"]), one["splits"]) for one in given["parameters"]), strict=True))
    for i, (row, entries) in enumerate(zip(a, given["jacobian"], strict=True)):
        for j, (x, entry) in enumerate(zip(row, map(s.form, entries), strict=True)):
            lines.append(f"J[{i}][{j}] = {s.written(entry)}")
            rest = {None: entry[0] - x, **dict(entry[1:])}
            for k, name in enumerate(tied):
                s.spend(len(rhos[name][0]))
                for node, y in [(None, rhos[name][0][0]), *rhos[name][0][1:]] if b[i][k] * c[k][j] else []:
                    rest[node] = rest.get(node, 0) - b[i][k] * c[k][j] * y
            if any(rest.values()): raise Refused(f"J[{i}][{j}] = a[{i}][{j}] + sum_k rho_k b[{i}][k] c[k][{j}], as formulas,")
    for name, low, high in dict.fromkeys(zip(tied, map(number, data["lower"]), map(number, data["upper"]), strict=True)):
        (rho, splits), order = rhos[name], s.order(rhos[name][0])
        lines.append(f"{exact(low)} <= {s.written(rho)} <= {exact(high)}")
        for leaf in leaves(splits, box):
            value, count = s.enclose(rho, order, leaf), count + 1
            if value is None or not low <= value.low <= value.high <= high:
                found = "undefined" if value is None else f"in {[*map(near, value)]}"
                raise Refused(f"{lines[-1]} ({found} on the leaf {[[*map(near, x)] for x in leaf]})")
    return count

def check(data):
    """{"holds", "why", "lines": the formulas} of a certificate as JSON gives it."""
    lines = []
    try: return {"holds": True, "why": f"the bounds hold for these formulas ({prove(data, lines)} leaves)", "lines": lines}
    except Refused as error: why = f"{error} fails"
    except ERRORS as error: why = f"malformed, {type(error).__name__}: {error!s:.80}"
    return {"holds": False, "why": f"bounds not proved: {why}", "lines": lines}

def once(pairs): return dict(pairs) if len(dict(pairs)) == len(pairs) else None  # a key given twice can be read in two ways
def main(paths):
    """Prints the verdicts; 0 if all hold, 1 if one does not, 2 if a file cannot be read."""
    code = 0
    for path in paths:
        try:
            if Path(path).stat().st_size > MOST_BYTES: raise ValueError(f"more than {MOST_BYTES} bytes")
            found = check(json.loads(Path(path).read_text(encoding="utf-8"), object_pairs_hook=once))
            print(f"{path}: {found['why']}", *found["lines"], sep="\n  ")
            code = max(code, int(not found["holds"]))
        except (OSError, ValueError, RecursionError) as error:
            print(f"{path}: no certificate: {error!s:.200}")
            code = 2
    return code

if __name__ == "__main__": sys.exit(main(sys.argv[1:]) if sys.argv[1:] else __doc__)
