"""The bounds that travel with a certificate, and the checker that re-proves them without jaxobs."""

import copy
import dataclasses
import math
import random
import shutil
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path

import bounds_mutations as mutations
import flint
import jax.numpy as jnp
import numpy as np
import pytest
from bounds_cases import DUFFING, field, models, travelling
from bounds_mutations import DEEP, HOSTILE, ZERO
from oracles import bounds as oracle

from jaxobs import plants
from jaxobs.certificates import checker_bounds, checker_more, load
from jaxobs.certificates.bounds import with_bounds
from jaxobs.designs import corner_lmi, lpv_from, lpv_model, slope_entries

NAMES = list(models())
SOURCE = Path(checker_bounds.__file__)
FUNCTIONS = ("sin", "cos", "tanh", "exp", "log", "sqrt", "atan", "erf")


def sealed(data):
    """With the hash of its contents: mathematics, not the hash, has to refuse it."""
    body = {key: value for key, value in data.items() if key != "sha256"}
    return body | {"sha256": checker_more.digest(body)}


@pytest.mark.parametrize("name", NAMES)
def test_the_checker_alone_accepts_the_file_in_an_isolated_interpreter(name, tmp_path):
    one = travelling()[name]
    assert one.verify().holds, one.verify().why
    one.to_json(tmp_path / "certificate.json")
    shutil.copy(SOURCE, tmp_path / "checker_bounds.py")
    command = [sys.executable, "-I", "-S", "checker_bounds.py", "certificate.json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"the bounds hold for these formulas ({one.leaves} leaves)" in done.stdout
    assert "J[1][0] = " in done.stdout
    assert load(tmp_path / "certificate.json") == one.certificate  # the rest of the file is the certificate


@pytest.mark.parametrize("name", NAMES)
def test_what_is_accepted_is_true_at_points_in_128_bit_balls(name):
    data = travelling()[name].to_dict()
    assert oracle.refuted(data, oracle.points_of(data["bounds"], 200, 1)) is None


def test_the_checker_is_short_and_needs_the_standard_library_only():
    text = SOURCE.read_text()
    assert len(text.splitlines()) <= 250
    assert max(map(len, text.splitlines())) <= 128
    imports = {line.split()[1].split(".")[0] for line in text.splitlines() if line.startswith(("import ", "from "))}
    assert imports <= set(sys.stdlib_module_names)


def arb(x):
    return flint.arb(flint.fmpq(x.numerator, x.denominator))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_at_one_number_encloses_the_400_bit_ball(name):
    draw, flint.ctx.prec = random.Random(name), 400
    for _ in range(300):
        size = 2.0 ** draw.uniform(-60, 29) if name != "erf" else draw.uniform(0, 9)
        x = Fraction(size * (1 if name in ("log", "sqrt") else draw.choice([-1, 1])))
        low, high = checker_bounds.at(name, x)
        value = getattr(arb(x), name)()
        assert not value < arb(low), (name, x)
        assert high == math.inf or not value > arb(high), (name, x)
        if high < math.inf:
            assert high - low <= abs(low) / 2**75 + Fraction(1, 2 ** (70 if name == "erf" else 95)), (name, x)
            if abs(x) < {"erf": 7, "exp": 1000, "sqrt": 0, "tanh": 0}.get(name, math.inf):  # the margin far exceeds roundings
                assert abs(value - arb((low + high) / 2)) <= arb((high - low) / 1000), (name, x)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_on_an_interval_contains_its_values(name):
    draw, flint.ctx.prec = random.Random(name), 128
    for _ in range(60):
        ends = sorted(draw.choice([0.0, draw.uniform(-3, 3), draw.uniform(-40, 40)]) for _ in range(2))
        a = checker_bounds.Interval(*map(Fraction, ends))
        found = a.apply(name)
        if found is None:
            assert name in ("log", "sqrt")
            assert ends[0] <= 0
            continue
        low, high = arb(found.low) if found.low > -math.inf else -flint.arb("inf"), arb(found.high)
        for x in [*ends, *(draw.uniform(*ends) for _ in range(10))]:
            value = getattr(arb(Fraction(x)), name)()
            assert not value < low, (name, ends, x)
            assert not value > high, (name, ends, x)


@pytest.mark.parametrize("n", [-3, -2, -1, 2, 3, 5])
def test_products_and_powers_contain_their_values_and_are_tight(n):
    draw = random.Random(n)
    for _ in range(100):
        a, b = (sorted(Fraction(draw.uniform(-4, 4)) for _ in range(2)) for _ in range(2))
        product = checker_bounds.Interval(*a) * checker_bounds.Interval(*b)
        ends = [x * y for x in a for y in b]
        slack = Fraction(1, 2**70)
        assert min(ends) - slack <= product.low <= min(ends) <= max(ends) <= product.high <= max(ends) + slack
        power = checker_bounds.Interval(*a) ** n
        if n < 0 and a[0] <= 0 <= a[1]:
            assert power is None
            continue
        ends = [x**n for x in a] + [Fraction(0)] * (n > 0 and a[0] < 0 < a[1])
        assert power.low <= min(ends) <= max(ends) <= power.high
        assert power.high - power.low <= (max(ends) - min(ends)) * (1 + slack) + slack * max(map(abs, ends))


def test_infinite_intervals():
    inf = math.inf
    whole, half = checker_bounds.Interval(-inf, inf), checker_bounds.Interval(Fraction(2), inf)
    assert whole * whole == whole
    assert whole * checker_bounds.Interval(Fraction(0), Fraction(0)) == (0, 0)
    assert whole**2 == (0, inf)
    assert whole**3 == whole
    assert half**-1 == (0, Fraction(1, 2))
    assert half.apply("exp").high == inf
    assert whole.apply("tanh") == (-1, 1)
    assert whole.apply("cos") == (-1, 1)
    assert (checker_bounds.Interval(-inf, Fraction(0))).apply("exp") == (0, 1)


def changed(name, *path, to):
    data = copy.deepcopy(travelling()[name].to_dict())
    target = data
    for key in path[:-1]:
        target = target[key]
    target[path[-1]] = to(target[path[-1]]) if callable(to) else to
    return sealed(data)


@pytest.mark.parametrize("what", HOSTILE)
def test_hostile_file_is_refused_with_the_reason(what):
    path, to, reason = HOSTILE[what]
    found = checker_bounds.check(changed("Duffing" if "tighter" not in what else "pendulum, tighter", *path, to=to))
    assert not found["holds"]
    assert reason in found["why"], found["why"]


def test_a_damaged_file_and_one_that_is_none(tmp_path, capsys):
    data = copy.deepcopy(travelling()["Duffing"].to_dict())
    data["upper"][0] = (5.0).hex()
    assert "SHA-256" in checker_bounds.check(data)["why"]
    for text in ("{", DEEP, "[]", "7", '{"sha256": 1}'):
        (tmp_path / "file.json").write_text(text)
        assert checker_bounds.main([str(tmp_path / "file.json")]) in (1, 2)
    assert checker_bounds.main([str(tmp_path / "none.json")]) == 2
    assert "no certificate" in capsys.readouterr().out


def test_a_key_given_twice_is_refused(tmp_path, capsys):
    travelling()["Duffing"].to_json(tmp_path / "file.json")
    text = (tmp_path / "file.json").read_text()
    assert checker_bounds.main([str(tmp_path / "file.json")]) == 0
    for key in ('"upper":', '"rho":', '"format":'):
        (tmp_path / "file.json").write_text(text.replace(key, f"{key} [], {key}", 1))
        assert checker_bounds.main([str(tmp_path / "file.json")]) == 1, key
    assert capsys.readouterr().out.count("bounds not proved: ") == 3


def test_numbers_are_printed_in_full():
    """A coefficient that is no float, or too small for one, is not rounded to the number that a reader expects."""
    for k in ("1" + "0" * 30 + "1/1" + "0" * 31, "1/1" + "0" * 400):
        parts = copy.deepcopy(travelling()["Duffing"].to_dict())
        parts["bounds"]["jacobian"][1][0][1][1] = k
        found = checker_bounds.check(sealed(parts))
        assert any(f"{Fraction(k)} (x1)^2" in line for line in found["lines"])
        assert not found["holds"]
    assert checker_bounds.exact(Fraction(0.1)) == "0.1"
    assert checker_bounds.exact(Fraction(1, 10)) == "1/10"


def squares(count):
    """x, then each node the square of the one before: exponents that double, count times."""
    return [["x", 0]] + [["^", [ZERO, [i, "0x1p0"]], 2] for i in range(count)]


def swelling(count):
    """Sums of products that would be exponentially long if they were written out."""
    return [["x", 0]] + [["*", [ZERO, [i, "0x1p0"]], ["0x1p0", [i, "0x1.8p0"]]] for i in range(count)]


@pytest.mark.parametrize("nodes", [squares(2000), swelling(1500), squares(6000)], ids=["squares", "swelling", "too many"])
def test_time_and_memory_stay_bounded(nodes):
    data = copy.deepcopy(travelling()["Duffing"].to_dict())
    data["bounds"]["nodes"] = nodes
    data["bounds"]["parameters"][0]["rho"] = [ZERO, [len(nodes) - 1, "0x1p0"]]
    data["bounds"]["jacobian"][1][0] = ["-0x1p0", [len(nodes) - 1, "-0x1.8p1"]]
    data["bounds"]["parameters"][0]["splits"] = [[0, "0x0p0"], *[0] * 2]
    start = time.process_time()
    found = checker_bounds.check(sealed(data))
    assert not found["holds"]
    assert time.process_time() - start < 20
    assert sum(map(len, found["lines"])) < 2_000_000


def check_of_many_leaves(count):
    data = copy.deepcopy(travelling()["pendulum"].to_dict())
    cuts = [[2, (-0.5 + (k + 1) / (count + 1)).hex()] for k in range(count)]
    data["bounds"]["parameters"][0]["splits"] = [x for cut in cuts for x in (cut, 0)] + [0]
    return checker_bounds.check(sealed(data))


def test_many_leaves_are_refused_before_they_take_long(monkeypatch):
    assert check_of_many_leaves(300)["holds"]
    monkeypatch.setattr(checker_bounds, "MOST_EFFORT", checker_bounds.MOST_EFFORT // 200)
    assert "short" in check_of_many_leaves(300)["why"]


@pytest.mark.slow
def test_the_longest_check_takes_about_a_minute():
    start = time.process_time()
    assert "short" in check_of_many_leaves(60_000)["why"]
    assert time.process_time() - start < 60


def test_wrong_bounds_and_wrong_matrices_are_refused_by_the_producer():
    one = travelling()["Duffing"].certificate
    box = [2.5, np.inf]
    with pytest.raises(ValueError, match=r"upper\[0\].*at x1 = "):
        with_bounds(one, field(DUFFING), np.negative(box), box)
    box = [2.0, np.inf]
    with pytest.raises(ValueError, match=r"leave 1e-06 of df/dx"):
        with_bounds(one, lambda x: field(DUFFING)(x) + 1e-6 * x[1] * np.array([0.0, 1.0]), np.negative(box), box)
    with pytest.raises(ValueError, match="lower <= upper"):
        with_bounds(one, field(DUFFING), [1.0, 0.0], [-1.0, 0.0])
    with pytest.raises(ValueError, match=r"a switch at x1 = 0.*continuous"):
        with_bounds(one, lambda x: jnp.where(x[0] > 0, field(DUFFING)(x), x), np.negative(box), box)
    narrow = dataclasses.replace(one, upper=(3.9,))
    with pytest.raises(ValueError, match=r"relax.*not certified"):
        with_bounds(narrow, field(DUFFING), np.negative(box), box, relax=1e6)


@pytest.mark.parametrize("ends", [(-1.7e308, 1.7e308), (1.7e308, math.inf), (-math.inf, -1.7e308), (-1e200, 1e200)], ids=str)
def test_a_box_as_wide_as_floats_go_is_refused_with_the_reason(ends):
    one = travelling()["Duffing"].certificate
    with pytest.raises(ValueError, match=r"upper\[0\].*at x1 = "):
        with_bounds(one, field(DUFFING), [ends[0], -np.inf], [ends[1], np.inf])
    data = copy.deepcopy(travelling()["Duffing"].to_dict())
    data["bounds"]["lower"][0], data["bounds"]["upper"][0] = (x.hex() for x in ends)
    data["bounds"]["parameters"][0]["splits"] = [0]
    assert "on the leaf" in checker_bounds.check(sealed(data))["why"]


def test_relaxed_bounds_contain_the_range_and_are_certified_again():
    one = dataclasses.replace(travelling()["Duffing"].certificate, rate=0.0)  # which leaves a margin
    narrow, box = dataclasses.replace(one, upper=(4.0 - 1e-6,)), [2.0, np.inf]
    with pytest.raises(ValueError, match=r"where rho = \(x1\)\^2 is 3\.999.* at x1 = "):
        with_bounds(narrow, field(DUFFING), np.negative(box), box)
    relaxed = with_bounds(narrow, field(DUFFING), np.negative(box), box, relax=1e-5)
    assert relaxed.certificate.upper[0] > 4 > narrow.upper[0]
    assert relaxed.verify().holds


@pytest.mark.slow
def test_models_of_lpv_from_are_reproduced_to_the_last_bit():
    box = np.array([2.0, 3.0])
    _, certificate = corner_lmi.synthesise(lpv_from(plants.VanDerPol(), None, (-box, box)).model, rate=0.05)
    found = with_bounds(certificate, field(plants.VanDerPol()), -box, box)
    assert found.certificate == certificate
    assert found.verify().holds


def test_saturated_plant_on_the_whole_space():
    plant = plants.Saturated(plants.Lorenz(), [-1.0] * 3, [1.0] * 3)
    entries = slope_entries(np.array([[-1, 0, -1], [-1, -1, 0.0]]), np.array([[1, 0, 1], [1, 1, 0.0]]))
    _, certificate = corner_lmi.synthesise(lpv_model(plant, entries), rate=0.1)
    found = with_bounds(certificate, field(plant), [-np.inf] * 3, [np.inf] * 3)
    assert found.verify().holds
    assert found.leaves == 4  # one for each entry: both branches of the switch are enclosed


@pytest.mark.parametrize(
    ("count", "points", "most"), [(200, 8, 20), pytest.param(3000, 30, 100, marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_no_mutated_file_that_is_false_is_accepted(count, points, most):
    counts = mutations.counted(count, seed=count, points=points, most=most)
    assert counts["accepted"] >= count / 8
    assert counts["confirmed"] >= counts["accepted"] / 3
    assert counts["refuted"] >= count / 8
