"""Ten thousand certificates with something changed and signed anew: accepted exactly when an independent oracle says they are
true, refused with the mathematical reason otherwise, never a crash, in bounded time and memory."""

import collections
import copy
import json
import math
import random
import subprocess
import sys
import time
from pathlib import Path

import mutation_seeds
import mutations
import numpy as np
import pytest
from mutations import checker
from oracles import flint_certificates as oracle

LIMITS = ("would take minutes", "2^30")  # how the checker says that a true claim is beyond its stated means
FORMAL = ("malformed", "SHA-256", "text is not", "jaxobs-cert")  # reasons that are no mathematics
OUTCOMES = {True: "true, accepted", False: "false, refused", None: "malformed, refused"}
BEYOND = "true, too long"
SECONDS = 10  # of one check of these small files


@pytest.fixture(scope="module")
def seeds():
    return [data for data in mutation_seeds.seeds() if data["theorem"] in checker.THEOREMS]


def test_every_theorem_has_seeds_that_both_judges_accept(seeds):
    assert {data["theorem"] for data in seeds} == set(checker.THEOREMS) == set(oracle.JUDGES)
    for data in seeds:
        found = checker.check(mutations.signed(data))
        assert found["holds"], (data["theorem"], found["why"])
        assert oracle.judge(data)


def compare(seeds, count, seed):
    """Counts by (theorem, outcome)."""
    rng, counts, slowest = random.Random(seed), collections.Counter(), 0.0
    for i in range(count):
        data = seeds[i % len(seeds)]
        how, changed = mutations.mutated(rng, data)
        truth, file = oracle.judge(changed), mutations.signed(changed)
        begin = time.process_time()
        found = checker.check(file)
        slowest = max(slowest, time.process_time() - begin)
        told = f"{data['theorem']}, {how}: oracle {truth}, checker {found['why']}: {changed}"
        beyond = bool(truth) and any(limit in found["why"] for limit in LIMITS)
        assert found["holds"] == (bool(truth) and not beyond), told
        assert found["why"].startswith("holds for" if found["holds"] else "not certified: "), told
        assert truth is not False or not any(word in found["why"] for word in FORMAL), told
        counts[data["theorem"], BEYOND if beyond else OUTCOMES[truth]] += 1
    return counts, slowest


def report(counts, slowest):
    """Prints the table, returns its last row."""
    columns = [*OUTCOMES.values(), BEYOND]
    print(f"\n{'theorem':24}" + "".join(f"{name:>22}" for name in columns))
    total = collections.Counter()
    for theorem in sorted({name for name, _ in counts}):
        print(f"{theorem:24}" + "".join(f"{counts[theorem, name]:22}" for name in columns))
        total.update({name: counts[theorem, name] for name in columns})
    print(f"{'all':24}" + "".join(f"{total[name]:22}" for name in columns) + f"\nslowest check: {slowest:.3f} s")
    return total


def judged(seeds, count, seed):
    counts, slowest = compare(seeds, count, seed)
    total = report(counts, slowest)
    assert total["true, accepted"] >= count / 4
    assert total["false, refused"] >= count / 10
    assert total[BEYOND] <= count / 200
    assert slowest < SECONDS
    return counts


def test_mutations_are_accepted_exactly_when_true(seeds):
    judged(seeds, 500, seed=1)


@pytest.mark.slow
def test_ten_thousand_mutations(seeds):
    counts = judged(seeds, 10_500, seed=2)
    assert all(counts[name, outcome] >= 10 for name in checker.THEOREMS for outcome in ("true, accepted", "false, refused"))


def test_texts_that_were_cut_or_garbled_are_refused(seeds, tmp_path, capsys):
    rng, refused = random.Random(3), 0
    for data in seeds:
        for text in mutations.broken_texts(rng, data):
            path = tmp_path / "c.json"
            path.write_text(text, encoding="utf-8")
            assert checker.main([str(path)]) in (1, 2), text
            refused += 1
    out = capsys.readouterr().out
    assert out.count("no certificate: ") + out.count("not certified: ") == refused
    assert refused == 6 * len(seeds)


def test_a_sign_that_matters_is_refused(seeds):
    """Every positive scalar made negative: the two judges agree here as well."""
    for data in seeds:
        for name, value in data.items():
            if isinstance(value, str) and name not in mutations.NO_FLOATS and float.fromhex(value) > 0:
                changed = data | {name: (-float.fromhex(value)).hex()}
                found = checker.check(mutations.signed(changed))
                assert found["holds"] == bool(oracle.judge(changed)), (data["theorem"], name, found["why"])


def test_the_hash_and_the_text_are_checked_too(seeds):
    for data in seeds:
        file = mutations.signed(data)
        assert "SHA-256" in checker.check(file | {"extra": 1})["why"]
        forged = {**file, "claim": "stable for every plant"}
        forged["sha256"] = checker.digest(forged)
        assert "text is not the theorem" in checker.check(forged)["why"]


def test_the_oracle_knows_the_theorems_from_elsewhere():
    """Closed forms: e' = -e + rho e with |rho| <= r decays at 1 - r and no faster; the norm of 1 / (s + 1)."""
    scalar = {"a": [[-1.0]], "b": [[1.0]], "c": [[1.0]], "output": [[1.0]], "gain": [[0.0]], "tied": (), "inner": ()}
    scalar |= {"lower": (-0.5,), "upper": (0.5,)}
    for rate in (0.4999, 0.5001):
        assert oracle.judge(mutation_seeds.proved("corners", scalar, [[1.0]], rate=rate)) == (rate < 0.5)
    still = scalar | {"lower": (0.0,), "upper": (0.0,)}
    for level in (0.9999, 1.0001):  # |1 / (s + 1)|_inf = 1, with Q = 1: [2 - 1, -1; -1, level^2] > 0
        more = {"weight": [[1.0]], "process": [[1.0]], "noise": [[0.0]], "rate": 0.0, "q": [[1.0]], "level": level}
        assert oracle.judge(mutation_seeds.proved("l2", still, [[1.0]], **more)) == (level > 1)
        variance = more | {"q": [[0.500001]], "level": level / 2}
        assert oracle.judge(mutation_seeds.proved("h2", still, [[1.0]], **variance)) == (level > 1)


def small(theorem, a, **fields):
    """A signed certificate of e' = a e without parameters, output the first state, unless fields say otherwise."""
    free = {"b": [[] for _ in a], "c": [], "lower": [], "upper": [], "tied": [], "output": [[1.0] + [0.0] * (len(a) - 1)]}
    return mutations.signed(
        {"theorem": theorem} | {k: mutation_seeds.encoded(v) for k, v in (free | {"a": a} | fields).items()}
    )


def test_a_floor_of_every_filter_needs_a_symmetric_witness():
    """With S = 100 I + 50 [0, 1; -1, 0] the inequality holds, but the covariance of e' = a e + 0.01 w is 1e-4 / 2 I."""
    a, s = [[-1.0, -10.0], [10.0, -1.0]], np.array([[100.0, 50.0], [-50.0, 100.0]])
    noise = {"process": [[0.01, 0.0], [0.0, 0.01]], "noise": [[10.0]], "weight": [[1.0, 0.0], [0.0, 1.0]], "rho": []}
    f, output = np.array(a) @ s, s[:, :1]
    block = np.block([[f + f.T + 1e-4 * np.eye(2), output], [output.T, 100 * np.eye(1)]])
    assert np.all(np.linalg.eigvalsh(block) > 0)
    for witness, level in ((s.tolist(), 200.0), (s.T.tolist(), 200.0)):
        found = checker.check(small("kalman-floor", a, **noise, s=witness, level=level))
        assert found["why"] == "not certified: S = S' fails"
    assert checker.check(small("kalman-floor", a, **noise, s=[[4e-5, 0.0], [0.0, 4e-5]], level=8e-5))["holds"]


def test_witnesses_have_to_be_symmetric(seeds):
    """A matrix that only its symmetric part enters proves nothing of x'P x, however small the rest."""
    for data in seeds:
        for name in {"p", "q", "x", "w", "s", "start"} & data.keys():
            if mutations.symmetric(data[name]):
                changed = copy.deepcopy(data)
                changed[name][0][1] = math.nextafter(float.fromhex(data[name][0][1]), math.inf).hex()
                assert not checker.check(mutations.signed(changed))["holds"], (data["theorem"], name)


def test_the_text_names_tied_channels():
    """e' = -e + rho_1 e - rho_2 e decays where rho_1 = rho_2, and only there."""
    two = {"b": [[1.0, 1.0]], "c": [[1.0], [-1.0]], "lower": [-5.0, -5.0], "upper": [5.0, 5.0], "output": [[1.0]]}
    rest = {"gain": [[0.0]], "inner": [], "left": [], "right": [], "tau": 0.0, "taus": [], "origin": "given", "p": [[1.0]]}
    for tied in ([0, 0], [0, 1], []):
        found = checker.check(small("corners", [[-1.0]], **two, **rest, rate=0.5, tied=tied))
        assert found["holds"] == (tied == [0, 0])
        assert f"rho_k equal for equal numbers in tied = {tuple(tied)}" in found["assumptions"][0]


def test_no_gain_speaks_of_the_norm_and_of_faster_decay():
    """e' = -e decays at the rate 1, e^2 at 2: no faster, which is all that may be said at the border."""
    ray = {"gain": [[0.0]], "points": [[]], "multipliers": [[1.0]], "step": 0, "radius": 0.0, "t": 0.0}
    for rate in (0.999, 1.0, 1.001):
        found = checker.check(small("no-gain", [[-1.0]], **ray, rate=rate))
        assert found["holds"] == (rate >= 1)
        assert f"makes sqrt(e'P e) decay faster than at the rate {rate}" in found["claim"]


def hostile_texts(seeds):
    """Files that try to crash the reader or to keep it busy, by name."""
    file = mutations.signed(seeds[0])
    text = json.dumps(file)
    yield "deep list", "[" * 100_000
    yield "deep list, closed", "[" * 100_000 + "]" * 100_000
    yield "deep table", '{"format":' * 100_000 + "1" + "}" * 100_000
    yield "deep field", text.replace('"tied": []', '"tied": ' + "[" * 50_000 + "]" * 50_000)
    yield "long list", text.replace('"tied": []', '"tied": [' + "0," * 999_999 + "0]")
    yield "long rows", text.replace('"tied": []', '"tied": [' + "[],[0]," * 200_000 + "0]")
    yield "digits of an integer", text.replace('"tied": []', '"tied": ' + "9" * 100_000)
    yield "digits of a float", text.replace("0x1.", "0x1." + "0" * 1_000_000, 1)
    yield "exponent", text.replace("p+0", "p+" + "9" * 100_000, 1)
    yield "decimal exponent", text.replace('"tied": []', '"tied": [1e999999999]')
    yield "not a number", text.replace('"tied": []', '"tied": [NaN, Infinity]')
    yield "surrogates", text.replace("given", "\\ud800")
    yield "null bytes", "\x00" * 1000
    yield "too long", " " * 2**25 + text
    yield "same key twice", "{" + '"gain": [["0x1p0"], ["0x1p0"]],' * 2 + text[1:]
    yield "empty", ""


RUN = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
resource.setrlimit(resource.RLIMIT_CPU, (90, 90))
sys.path.insert(0, sys.argv[1])
import checker_more
code = checker_more.main(sys.argv[2:])
print(f"{resource.getrusage(resource.RUSAGE_SELF).ru_utime:.1f} s")
sys.exit(code)
"""


def alone(*paths):
    """The checker on these files in a Python of its own, with 1 GiB of address space and 90 s of CPU."""
    folder = str(Path(checker.__file__).parent)
    command = [sys.executable, "-I", "-S", "-c", RUN, folder, *map(str, paths)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def test_hostile_files_are_refused_in_little_time_and_memory(seeds, tmp_path):
    paths = []
    for name, text in hostile_texts(seeds):
        paths.append(tmp_path / f"{name}.json")
        paths[-1].write_text(text, encoding="utf-8")
    (tmp_path / "latin.json").write_bytes(b"\xff\xfe\x00{")
    paths += [tmp_path / "latin.json", tmp_path / "missing.json", tmp_path]
    result = alone(*paths)
    assert result.returncode == 2, result.stderr[-2000:]
    assert not result.stderr
    for path in paths:
        line = next(line for line in result.stdout.splitlines() if line.startswith(f"{path}: "))
        assert "no certificate: " in line or "not certified: " in line, line[:200]
    print(result.stdout.splitlines()[-1])


def wild(rng, *shape):
    """53 digits each, from 2^-1000 to 2^990: the longest sums that floats allow."""
    if shape:
        return [wild(rng, *shape[1:]) for _ in range(shape[0])]
    return (rng.choice((-1, 1)) * rng.uniform(1, 2) * 2.0 ** rng.randint(-1000, 990)).hex()


def wild_box(rng, n, r, p):
    """A box of r parameters with such numbers."""
    ends = {"lower": [(-1.0 - k / 7).hex() for k in range(r)], "upper": [(1.0 + k / 3).hex() for k in range(r)]}
    return ends | {"a": wild(rng, n, n), "b": wild(rng, n, r), "c": wild(rng, r, n), "output": wild(rng, p, n),
                   "gain": wild(rng, n, p), "tied": [], "inner": []}  # fmt: skip


def wild_files():
    """Certificates of the largest sizes with numbers of the most digits."""
    rng, unit = random.Random(0), mutation_seeds.encoded
    eye = unit(np.eye(12))
    rest = {"left": [], "right": [], "tau": "0x0p0", "taus": [], "origin": "given", "p": eye, "rate": "0x0p0"}
    positive = [(abs(float.fromhex(x))).hex() for x in wild(rng, 64)]
    yield "corners", {**wild_box(rng, 12, 64, 3), **rest}
    yield "corners", {**wild_box(rng, 12, 12, 3), **rest}
    yield "corners", {**wild_box(rng, 12, 4, 3), **rest}
    yield "corners", {**wild_box(rng, 12, 64, 3), **rest, "taus": positive}
    yield "step-corners", {**wild_box(rng, 12, 4, 3), **rest, "factor": "0x1p0"}
    many = {"weight": wild(rng, 12, 12), "process": wild(rng, 12, 12), "noise": wild(rng, 3, 12), "level": "0x1p900"}
    yield "h2", {**wild_box(rng, 12, 4, 3), **rest, **many, "q": [], "x": eye, "taus_q": [], "inner": wild(rng, 4, 3)}
    yield "l2", {**wild_box(rng, 12, 4, 3), **rest, **many, "q": eye, "taus_q": []}
    ends = {"lower": [(-1e300).hex()] * 12, "upper": [(1e-300).hex()] * 12}
    yield "hg-lmi", {"gain": wild(rng, 12), "theta": 1e200.hex(), "sigma": 1.1.hex(), "j0": 12, **ends, "p": eye,
                     "constant": "0x1p0", "lam": 1e308.hex(), "nu": 1e308.hex()}  # fmt: skip
    alone = {name: value for name, value in wild_box(rng, 12, 12, 3).items() if name != "inner"}
    points = {"points": unit([[0.1] * 12] * 256), "multipliers": eye * 256, "radius": "0x0p0", "t": "0x0p0", "rate": "0x1p0"}
    yield "no-gain", {**alone, **points, "step": 1}
    yield "switching-instability", {**alone, "points": unit([[0.1] * 12] * 256), "durations": unit([1e3] * 256),
                                    "repeats": 256, "step": 0, "scale": []}  # fmt: skip
    yield "frozen-instability", {**alone, "rho": unit([0.1] * 12), "step": 1}


@pytest.mark.slow
def test_the_largest_sizes_with_the_longest_numbers_end_in_time(tmp_path):
    for place, (theorem, fields) in enumerate(wild_files()):
        path = tmp_path / f"{place}.json"
        path.write_text(json.dumps(mutations.signed({"theorem": theorem, **fields})), encoding="utf-8")
        result = alone(path)
        assert result.returncode in (0, 1), (theorem, result.returncode, result.stderr[-500:])
        first, *_, last = result.stdout.splitlines()
        print(f"{theorem}: {last} of CPU, {first.split(': ', 1)[1]:.80}")
        assert "malformed" not in result.stdout
