"""Mutated and hostile certificates with travelling bounds, with a hash that fits: mathematics has to refuse them."""

import contextlib
import copy
import json
import math
import random
import struct

import bounds_cases
import numpy as np
from oracles import bounds as oracle

from jaxobs.certificates import checker_bounds, checker_more

OPERATIONS = ["sin", "cos", "tanh", "exp", "log", "sqrt", "atan", "erf", "*", "min", "^", "x", "<="]
UNREADABLE = (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError, ZeroDivisionError)
PARTS = ["a", "b", "c", "lower", "upper", "tied", *["bounds"] * 6]


DEEP = "[" * 3000 + "]" * 3000
ZERO = "0x0.0p+0"
HOSTILE = {
    "a bound inside the range": (("upper", 0), lambda x: (float.fromhex(x) - 1e-3).hex(), "on the leaf"),
    "one bit of a": (("a", 1, 0), lambda x: np.nextafter(float.fromhex(x), 9.0).item().hex(), "as formulas"),
    "one bit of b": (("b", 1, 0), lambda x: np.nextafter(float.fromhex(x), 9.0).item().hex(), "as formulas"),
    "a truncated bisection": (("bounds", "parameters", 0, "splits"), lambda x: x[:-1], "the leaves cover the box"),
    "a bisection that goes on": (("bounds", "parameters", 0, "splits"), lambda x: [*x, 0], "follows the last leaf"),
    "a cut outside its box": (("bounds", "parameters", 0, "splits"), lambda x: [[0, "0x1p9"], 0, 0], "within the box it cuts"),
    "a cut along no variable": (("bounds", "parameters", 0, "splits"), lambda x: [[7, "0x0p0"], 0, 0], "an integer from 0"),
    "a cut that is not a number": (("bounds", "parameters", 0, "splits"), lambda x: [[0, "nan"], 0, 0], "malformed"),
    "a node that refers to itself": (("bounds", "nodes", 1), ["sin", [ZERO, [1, "0x1p0"]]], "an integer from 0 to 0"),
    "a node that refers ahead": (("bounds", "nodes", 1), ["sin", [ZERO, [3, "0x1p0"]]], "an integer from 0 to 0"),
    "an unknown operation": (("bounds", "nodes", 1), ["eval", [ZERO]], "a known operation"),
    "too many arguments": (("bounds", "nodes", 1), ["sin", [ZERO], [ZERO]], "a known operation"),
    "a node twice in a sum": (("bounds", "jacobian", 1, 0), [ZERO, [0, "1/2"], [0, "1/2"]], "names its nodes once"),
    "a huge power": (("bounds", "nodes", 1), ["^", [ZERO, [0, "0x1p0"]], 10**9], "an integer from -64 to 64"),
    "no integer for a power": (("bounds", "nodes", 1), ["^", [ZERO, [0, "0x1p0"]], 2.0], "an integer from -64 to 64"),
    "a division by zero": (("bounds", "nodes", 1), ["^", [ZERO, [0, "0x1p0"]], -1], "undefined"),
    "the logarithm of a negative number": (("bounds", "nodes", 1), ["log", [ZERO, [0, "0x1p0"]]], "undefined"),
    "a huge exponent": (("a", 0, 0), "0x1p99999999999", "malformed"),
    "a huge fraction": (("bounds", "jacobian", 0, 0), ["1" * 400 + "/1"], "malformed"),
    "a fraction of many digits": (("bounds", "jacobian", 0, 0), ["1" * 5000 + "/7"], "malformed"),
    "a fraction with an exponent": (("bounds", "jacobian", 0, 0), ["1e999999999/7"], "malformed"),
    "a number that is no text": (("bounds", "jacobian", 0, 0), [0.0], "malformed"),
    "NaN": (("upper", 0), "nan", "malformed"),
    "a NaN in the box": (("bounds", "lower", 0), "nan", "lower <= upper"),
    "an empty box": (("bounds", "lower", 0), "inf", "lower <= upper"),
    "infinite bounds": (("upper", 0), "inf", "malformed"),
    "no parameters": (("bounds", "parameters"), [], "malformed"),
    "no box": (("bounds", "upper"), [], "malformed"),
    "a list for a name": (("bounds", "variables", 0), ["x1"], "malformed"),
    "a name of two lines": (("bounds", "variables", 0), "x1\nfile.json: the bounds hold", "plain names"),
    "a name that looks like another": (("bounds", "variables", 0), "\u0445\u0661", "plain names"),
    "a column of b that no bound is about": (("b",), lambda b: [[*row, "0x1p0"] for row in b], "one column of b"),
    "a name twice": (("bounds", "variables", 0), "x2", "plain names"),
    "another format": (("bounds", "format"), "jaxobs-bounds/2", "format"),
    "no bounds": (("bounds",), None, "malformed"),
    "deep nesting": (("bounds", "nodes"), json.loads("[" * 200 + "]" * 200), "malformed"),
}


def flipped(draw, x):
    """A bit of a float."""
    (bits,) = struct.unpack("<q", struct.pack("<d", x))
    (y,) = struct.unpack("<d", struct.pack("<q", bits ^ (1 << draw.randrange(63))))
    return y


def of_text(draw, text):
    if draw.random() < 0.05:
        return draw.choice(["nan", "inf", "0x1p99999", "1/0", "7/3", "", "0x0p0", "1" * 3000])
    try:
        x = float.fromhex(text)
    except ValueError:
        return text[:-1]
    choices = [flipped(draw, x), math.nextafter(x, math.inf), math.nextafter(x, -math.inf), -x, x * 1.5, x * 0.9, x + 1, x - 1]
    return draw.choice(choices).hex()


def of_list(draw, items):
    items, kind = list(items), draw.randrange(4)
    if kind == 0 and items:
        items.pop(draw.randrange(len(items)))
    elif kind == 1 and items:
        items.insert(draw.randrange(len(items)), copy.deepcopy(draw.choice(items)))
    elif kind == 2 and len(items) > 1:
        i, j = draw.sample(range(len(items)), 2)
        items[i], items[j] = items[j], items[i]
    else:
        items = items[: draw.randrange(len(items) + 1)]
    return items


def of(draw, value):
    if isinstance(value, str):
        return draw.choice(OPERATIONS) if value in OPERATIONS else of_text(draw, value)
    if isinstance(value, list):
        return of_list(draw, value)
    if isinstance(value, int):
        return draw.choice([value + 1, value - 1, 2, 3, 10**6, -1, True])
    return draw.choice([None, 0, [], {}])


def places(value, path=()):
    """The paths to everything inside a value, itself included."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from places(inner, (*path, key))


def anywhere(draw, data):
    """One thing changed, wherever it stands."""
    part = draw.choice([key for key in PARTS if key in data])
    *path, last = draw.choice([p for p in places(data[part], (part,)) if len(p) > 1 or part == "tied"])
    target = data
    for key in path:
        target = target[key]
    target[last] = of(draw, target[last])


def bounds_moved(draw, data):
    """The two bounds of a channel moved, by a little or by much, outwards or inwards."""
    k = draw.randrange(len(data["lower"]))
    low, high = (float.fromhex(data[key][k]) for key in ("lower", "upper"))
    size = (high - low) * 2.0 ** draw.randrange(-54, 2)
    moves = {"lower": low - draw.choice([0, 1, 1, -1]) * size, "upper": high + draw.choice([0, 1, 1, -1]) * size}
    tied = data["tied"] or list(range(len(data["lower"])))
    for key, value in moves.items():
        for j, name in enumerate(tied):
            if name == tied[k]:
                data[key][j] = value.hex()


def box_moved(draw, data):
    k, key = draw.randrange(len(data["bounds"]["lower"])), draw.choice(["lower", "upper"])
    x = float.fromhex(data["bounds"][key][k])
    data["bounds"][key][k] = (draw.uniform(-3, 3) if math.isinf(x) else x * draw.choice([0.5, 0.99, 1.01, 2.0])).hex()


def cut_more(draw, data):
    """A leaf cut in two, somewhere."""
    splits = draw.choice(data["bounds"]["parameters"])["splits"]
    leaf = draw.choice([k for k, one in enumerate(splits) if one == 0])
    v = draw.randrange(len(data["bounds"]["variables"]))
    splits[leaf : leaf + 1] = [[v, draw.uniform(-4, 4).hex()], 0, 0]


def mutated(draw):
    """(name of the certificate, a mutated file with the right hash)."""
    name = draw.choice(list(bounds_cases.travelling()))
    data = copy.deepcopy(bounds_cases.travelling()[name].to_dict())
    for _ in range(draw.choice([1, 1, 1, 2])):
        with contextlib.suppress(*UNREADABLE):  # a second change may not find what the first has destroyed
            draw.choice([anywhere, anywhere, bounds_moved, box_moved, cut_more])(draw, data)
    body = {key: value for key, value in data.items() if key != "sha256"}
    return name, body | {"sha256": checker_more.digest(body)}


def refutation(draw, data, points):
    """A sentence with a point of the box that refutes the file, None, or "malformed" for what cannot be read."""
    try:
        return oracle.refuted(data, oracle.points_of(data["bounds"], points, draw.randrange(10**6)))
    except UNREADABLE as error:
        return f"malformed: {error}"


def counted(count, seed, points, most):
    """Judges mutated files: how many are accepted (of these, confirmed by balls over the box), refused and refuted by a point,
    refused as malformed, refused although no point refutes them. AssertionError where a false one is accepted."""
    draw, counts = random.Random(seed), dict.fromkeys(("accepted", "confirmed", "refuted", "malformed", "not refuted"), 0)
    for _ in range(count):
        _, data = mutated(draw)
        found, refuted = checker_bounds.check(data), refutation(draw, data, points)
        if found["holds"]:
            confirmed = oracle.bounded(data, most=most)
            assert refuted is None, (refuted, data)
            assert confirmed is not False, data
            counts["accepted"] += 1
            counts["confirmed"] += confirmed is True
        else:
            assert found["why"].startswith("bounds not proved: "), found
            counts["not refuted" if refuted is None else "malformed" if refuted.startswith("malformed") else "refuted"] += 1
    print(count, "mutated files:", counts)
    return counts
