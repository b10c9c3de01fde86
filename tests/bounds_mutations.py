"""Mutated certificates with travelling bounds: each with a hash that fits, so that mathematics has to refuse it."""

import contextlib
import copy
import math
import random
import struct

import bounds_cases
from oracles import bounds as oracle

from jaxobs.certificates import checker_bounds, checker_more

OPERATIONS = ["sin", "cos", "tanh", "exp", "log", "sqrt", "atan", "erf", "*", "min", "^", "x", "<="]
UNREADABLE = (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError, ZeroDivisionError)
PARTS = ["a", "b", "c", "lower", "upper", "tied", *["bounds"] * 6]


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


def refutation(draw, data, points=30):
    """A sentence with a point of the box that refutes the file, None, or "malformed" for what cannot be read."""
    try:
        return oracle.refuted(data, oracle.points_of(data["bounds"], points, draw.randrange(10**6)))
    except UNREADABLE as error:
        return f"malformed: {error}"


def counted(count, seed):
    """Judges mutated files: how many are accepted (of these, confirmed by balls over the box), refused and refuted by a point,
    refused as malformed, refused although no point refutes them. AssertionError where a false one is accepted."""
    draw, counts = random.Random(seed), dict.fromkeys(("accepted", "confirmed", "refuted", "malformed", "not refuted"), 0)
    for _ in range(count):
        _, data = mutated(draw)
        found, refuted = checker_bounds.check(data), refutation(draw, data)
        if found["holds"]:
            confirmed = oracle.bounded(data, most=100)
            assert refuted is None, (refuted, data)
            assert confirmed is not False, data
            counts["accepted"] += 1
            counts["confirmed"] += confirmed is True
        else:
            assert found["why"].startswith("bounds not proved: "), found
            counts["not refuted" if refuted is None else "malformed" if refuted.startswith("malformed") else "refuted"] += 1
    print(count, "mutated files:", counts)
    return counts
