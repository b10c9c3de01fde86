"""Certificates with something changed: digits, signs, exponents, bounds, corners, margins, types, sizes. Then signed anew, so
that mathematics and not the hash has to tell."""

import copy
import json
import math

from jaxobs.certificates import checker_more as checker

NO_FLOATS = {"theorem", "origin"}


def signed(data):
    """With the wording of its theorem for these numbers, where they have the right types, and the hash of what is there."""
    data = {"format": "jaxobs-cert/1", "claim": "", "assumptions": [], **data}
    try:
        shown, _ = checker.parsed(checker.THEOREMS[data["theorem"]].kinds, data)
        data |= checker.statement(data["theorem"], shown)
    except Exception:
        pass  # no certificate of the theorem: whatever its wording
    return data | {"sha256": checker.digest(data)}


def places(data):
    """Where the floats are: (field, index, ...)."""

    def inside(value, path):
        if isinstance(value, list):
            for i, entry in enumerate(value):
                yield from inside(entry, (*path, i))
        elif isinstance(value, str):
            yield path

    return [path for name, value in data.items() if name not in NO_FLOATS for path in inside(value, (name,))]


def get(data, path):
    for step in path:
        data = data[step]
    return data


def put(data, path, value):
    get(data, path[:-1])[path[-1]] = value


def symmetric(matrix):
    """Whether a field is a symmetric matrix of at least two rows."""
    n = len(matrix) if isinstance(matrix, list) else 0
    square = n > 1 and all(isinstance(row, list) and len(row) == n for row in matrix)
    return square and all(matrix[i][j] == matrix[j][i] for i in range(n) for j in range(i))


def set_float(rng, data, path, x, mirror=0.9):
    """A new float; at the mirrored place of a symmetric matrix too, mostly."""
    keep = len(path) == 3 and symmetric(data[path[0]]) and rng.random() < mirror
    put(data, path, float(x).hex())
    if keep:
        put(data, (path[0], path[2], path[1]), float(x).hex())


def bit(rng, x):
    """One of the 52 digits of the mantissa flipped, the low and the high ones alike."""
    mantissa, exponent = math.frexp(x)
    whole = int(math.ldexp(abs(mantissa), 53)) ^ (1 << rng.randrange(52))
    return math.copysign(math.ldexp(whole, exponent - 53), x)


DIGITS = (
    bit,
    lambda rng, x: math.nextafter(x, rng.choice((0.0, math.inf, -math.inf))),
    lambda rng, x: x * (1 + rng.choice((-1, 1)) * 10 ** rng.uniform(-12, -0.5)),
    lambda rng, x: x * 10 ** rng.uniform(-0.5, 0.5),
    lambda rng, x: x + rng.choice((-1, 1)) * 10 ** rng.uniform(-9, -1),
)
COARSE = (lambda rng, x: -x, lambda rng, x: 0.0, lambda rng, x: math.ldexp(x, rng.choice((-40, -4, 4, 40))))
EXTREME = (1.7976931348623157e308, -1.7976931348623157e308, 5e-324, 2.0**-1022, 2.0**700, -(2.0**900), 2.0**-500)
NOT_FINITE = ("nan", "inf", "-inf", "0x1p5000", "-0x1.8p9999")


def digits(rng, data):
    """One to three numbers, by anything from the last digit to a factor of three."""
    for path in rng.sample(places(data), min(rng.choice((1, 1, 1, 2, 3)), len(places(data)))):
        set_float(rng, data, path, rng.choice(DIGITS)(rng, float.fromhex(get(data, path))))


def coarse(rng, data):
    path = rng.choice(places(data))
    set_float(rng, data, path, rng.choice(COARSE)(rng, float.fromhex(get(data, path))))


def extreme(rng, data):
    set_float(rng, data, rng.choice(places(data)), rng.choice(EXTREME))


def not_finite(rng, data):
    put(data, rng.choice(places(data)), rng.choice(NOT_FINITE))


def margins(rng, data):
    """A scalar (rate, level, radius, ...) or one side of a box relaxed or tightened: a little, or a lot."""
    names = [name for name, value in data.items() if isinstance(value, str) and name not in NO_FLOATS]
    names += [name for name in ("lower", "upper") if data.get(name)]
    name, by = rng.choice(names), 10 ** rng.uniform(-12, 0) * rng.choice((-1, 1))
    for path in [path for path in places(data) if path[0] == name]:
        x = float.fromhex(get(data, path))
        put(data, path, (x * (1 + by) if isinstance(data[name], str) else x + by).hex())


def scaled(rng, data):
    """All of P, of Q, of the multipliers or of the gain by one factor."""
    name = rng.choice(sorted({path[0] for path in places(data)}))
    factor = rng.choice((2.0**-20, 0.5, 2.0, 2.0**20, 1 + 10 ** rng.uniform(-6, -1)))
    for path in [path for path in places(data) if path[0] == name]:
        put(data, path, (float.fromhex(get(data, path)) * factor).hex())


def swapped(rng, data):
    """Two rows or entries of a field, the two ends of a box, or rows for columns."""
    lists = [name for name, value in data.items() if isinstance(value, list) and value and name in {p[0] for p in places(data)}]
    name = rng.choice(lists)
    if name in ("lower", "upper"):
        data["lower"], data["upper"] = data["upper"], data["lower"]
    elif isinstance(data[name][0], list) and rng.random() < 0.3:
        data[name] = [list(column) for column in zip(*data[name], strict=False)]
    else:
        i, j = rng.randrange(len(data[name])), rng.randrange(len(data[name]))
        data[name][i], data[name][j] = data[name][j], data[name][i]


def integers(rng, data):
    names = [name for name, value in data.items() if type(value) is int]
    if data.get("tied") and (not names or rng.random() < 0.5):
        data["tied"][rng.randrange(len(data["tied"]))] = rng.choice((0, 1, 2, -7, 10**9, True, None))
    elif names:
        name = rng.choice(names)
        data[name] = rng.choice((data[name] + 1, data[name] - 1, -data[name], 10**30, 10**4000, float(data[name]), True))
    else:
        data["tied"] = rng.choice(([0], [0, 0], [0, 1, 2], 0, "0", [0.0]))


ROWS = ([[]], [None], ["0x1p0"], [["0x1p0"]], [["0x1p0"], []], [3.0])
WRONG = (None, True, 3, 2.5, "", "six", "0x", [], {}, {"0": "0x1p0"}, *ROWS)


def structure(rng, data):
    """A field of another type or size, none at all, one row more or less, numbers in place of hexadecimal texts."""
    name = rng.choice([name for name in data if name != "theorem"])
    how = rng.randrange(5)
    if how == 0:
        del data[name]
    elif how == 1 or not (isinstance(data[name], list) and data[name]):
        data[name] = copy.deepcopy(rng.choice(WRONG))
    elif how == 2:
        data[name].append(copy.deepcopy(data[name][-1]))
    elif how == 3:
        data[name].pop(rng.randrange(len(data[name])))
    else:
        path = rng.choice([path for path in places(data) if path[0] == name] or [(name,)])
        put(data, path, rng.choice((3, 1.5, None, True, [], ["0x1p0"], "six", "0x1p0 ", {})))


def hostile(rng, data):
    """Nesting, lengths and digits without measure."""
    name = rng.choice([name for name in data if name != "theorem"])
    how = rng.randrange(4)
    if how == 0:
        deep = []
        for _ in range(rng.choice((10, 500))):
            deep = [deep]
        data[name] = deep
    elif how == 1:
        data[name] = ["0x1p0"] * rng.choice((13, 65, 257, 100_000))
    elif how == 2:
        data[name] = [["0x1p0"] * 300] * 300
    else:
        data[name] = rng.choice((10**4000, "0x1" + "0" * 100_000, "0x1p-1073", "x" * 100_000))


KINDS = {
    digits: 42,
    margins: 18,
    scaled: 8,
    swapped: 8,
    coarse: 7,
    extreme: 4,
    not_finite: 3,
    integers: 4,
    structure: 5,
    hostile: 1,
}


def mutated(rng, data):
    """(name of the change, the certificate changed)."""
    kind = rng.choices(list(KINDS), KINDS.values())[0]
    data = copy.deepcopy(data)
    try:
        kind(rng, data)
    except OverflowError:  # a float that left the range
        extreme(rng, data)
    return kind.__name__, data


def broken_texts(rng, data):
    """Texts of a file that was cut, garbled or never was a certificate."""
    text = json.dumps(signed(data))
    cut = rng.randrange(1, len(text))
    yield text[:cut]
    yield text[: cut // 2] + text[cut:]
    yield text[:cut] + rng.choice("[]{},:\"'0xp\x00") + text[cut:]
    yield text.replace('"0x1', "0x1", 1)
    yield text.replace("0x1", rng.choice(("NaN", "Infinity", "0x9")), 1)
    yield text + text
