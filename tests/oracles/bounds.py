"""Travelling bounds at single points, in 128-bit balls (python-flint): what a file claims, seen without its checker."""

import itertools
import random
from fractions import Fraction

import flint


def ball(text):
    value = Fraction(text) if "/" in text else Fraction(float.fromhex(text))
    return flint.arb(flint.fmpq(value.numerator, value.denominator))


def total(form, known):
    return ball(form[0]) + sum((ball(k) * known[j] for j, k in form[1:]), flint.arb(0))


def nodes_at(bounds, point):
    """The balls of all nodes where the variables are these balls."""
    known = []
    for name, *args in bounds["nodes"]:
        if name == "x":
            known.append(point[args[0]])
            continue
        a, *more = [total(form, known) if isinstance(form, list) else form for form in args]
        if name == "^":
            known.append(a ** more[0] if more[0] >= 0 else 1 / a ** -more[0])
        elif name == "*":
            known.append(a * more[0])
        elif name == "min":
            known.append(a.min(more[0]))
        elif name == "<=":
            known.append(more[0] if a <= 0 else more[1] if a > 0 else more[0].union(more[1]))
        else:
            known.append(getattr(a, name)())
    return known


def refuted(data, points):
    """A sentence that names a point of the box at which the claim fails beyond doubt, or None."""
    flint.ctx.prec = 128
    bounds, tied = data["bounds"], data["tied"] or list(range(len(data["lower"])))
    names = list(dict.fromkeys(tied))
    for point in points:
        known = nodes_at(bounds, [flint.arb(x) for x in point])
        rho = {name: total(one["rho"], known) for name, one in zip(names, bounds["parameters"], strict=True)}
        for k, name in enumerate(tied):
            if rho[name] < ball(data["lower"][k]) or rho[name] > ball(data["upper"][k]):
                return f"rho of channel {k} is {rho[name]} at {point}"
        for (i, row), j in itertools.product(enumerate(bounds["jacobian"]), range(len(bounds["jacobian"]))):
            given = ball(data["a"][i][j])
            given += sum((ball(data["b"][i][k]) * ball(data["c"][k][j]) * rho[one] for k, one in enumerate(tied)), flint.arb(0))
            if not (total(row[j], known) - given).contains(0):
                return f"J[{i}][{j}] differs at {point}"
    return None


def bounded(data, slack=1e-6, most=3000):
    """Whether balls over the whole box (infinite sides cut at 100) confirm all bounds, up to a slack relative to their width;
    None if that takes more than `most` boxes, or meets a place without value."""
    flint.ctx.prec = 128
    bounds, tied = data["bounds"], data["tied"] or list(range(len(data["lower"])))
    sides = [[float.fromhex(x) for x in bounds[key]] for key in ("lower", "upper")]
    whole = [(max(a, -100.0), min(b, 100.0)) for a, b in zip(*sides, strict=True)]
    for name, one in zip(dict.fromkeys(tied), bounds["parameters"], strict=True):
        low, high = (float(ball(data[key][tied.index(name)])) for key in ("lower", "upper"))
        margin = slack * max(high - low, abs(low), abs(high), 1e-300)
        stack, count = [whole], 0
        while stack:
            box, count = stack.pop(), count + 1
            rho = total(one["rho"], nodes_at(bounds, [flint.arb((a + b) / 2, (b - a) / 2 + 1e-14) for a, b in box]))
            if not rho.is_finite() or count > most:
                return None
            if low - margin <= float(rho.lower()) and float(rho.upper()) <= high + margin:
                continue
            k = max(range(len(box)), key=lambda k: box[k][1] - box[k][0])
            a, b = box[k]
            stack += [[*box[:k], half, *box[k + 1 :]] for half in ((a, (a + b) / 2), ((a + b) / 2, b))]
            if b - a < 1e-9:
                return False
    return True


def points_of(bounds, count, seed):
    """Corners of the box and of the leaves, turning points of sines, zero, and points drawn from the box."""
    draw = random.Random(seed)
    low, high = ([float.fromhex(x) for x in bounds[key]] for key in ("lower", "upper"))
    special = [0.0, *(k * 1.5707963267948966 for k in range(-4, 5))]
    cuts = [[] for _ in low]
    for one in bounds["parameters"]:
        for cut in one["splits"]:
            if cut != 0:
                cuts[cut[0]].append(float(ball(cut[1])))

    def inside(k):
        near = [x for x in (low[k], high[k], *special, *cuts[k]) if abs(x) < 1e300 and low[k] <= x <= high[k]]
        a, b = max(low[k], -1e3), min(high[k], 1e3)
        return draw.choice(near) if near and draw.random() < 0.6 else draw.uniform(a, b) if a <= b else low[k]

    return [[inside(k) for k in range(len(low))] for _ in range(count)]
