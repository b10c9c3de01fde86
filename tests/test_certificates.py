"""Certificates: true claims pass, false ones are refused with their reason, files are never trusted."""

import contextlib
import dataclasses
import itertools
import json
import re
import time
import typing

import numpy as np
import pytest
from mutation_seeds import random_condition
from oracles import flint_certificates as oracle
from oracles import riccati

from jaxobs import certificates
from jaxobs.certificates import Condition5, base, checker

ALPHAS, GAMMA, RHO = (3.0, 2.0), 6.0, 1.5  # paper 000, (68)-(71): mu < 3.5620, nu > 1299.9..., the edge of rho is 1.5683


def paper(**changes):
    p, _ = riccati.solve(ALPHAS, GAMMA)
    mu, nu = riccati.parts(ALPHAS, GAMMA)[0] * (1 - 1e-9), np.linalg.eigvalsh(p)[-1] * (1 + 1e-9)
    return dataclasses.replace(Condition5(ALPHAS, GAMMA, RHO, 2, 0, float(mu), float(nu)), **changes)


def judged(c):
    return bool(oracle.judge(c.to_dict()))


def random_certificate(rng):
    return Condition5(**random_condition(rng))


def test_a_true_claim_holds_with_its_margins():
    verdict = paper().verify()
    assert verdict
    assert verdict.why == "holds for the stored model and bounds, in exact arithmetic"
    assert verdict.margins["largest_lipschitz"] == pytest.approx(1.568266599598, rel=1e-8)
    assert verdict.margins["decay_rate_of_V"] == pytest.approx(3.5620382 - 1.5 * 2.2713219, rel=1e-6)
    assert dataclasses.replace(paper(), n=1, q=1).verify()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"mu": 3.5621}, "Q - mu P > 0 fails"),
        ({"nu": 1000.0}, "nu I - P > 0 fails"),
        ({"nu": 1700.0}, "the margin must be positive"),
        ({"mu": 3.0}, "the margin must be positive"),
        ({"lipschitz": 1.5683}, "the margin must be positive"),
        ({"gamma": 5.7}, "Q - mu P > 0 fails"),
        ({"gamma": 6.3}, "nu I - P > 0 fails"),
        ({"alphas": (1.0, 2.0)}, "condition (10), q_1 = -3 > 0, fails"),
        ({"alphas": (-3.0, 2.0)}, "P > 0 fails"),
        ({"alphas": (3.0, 2.0, 1.0)}, "3 alphas for n = 2, q = 0"),
        ({"n": 0, "q": 2}, "n = 0"),
        ({"lipschitz": 0.0}, "positive gamma, Lipschitz constant"),
        ({"mu": -1.0}, "mu and nu fails"),
        ({"nu": float("inf")}, "nu: cannot convert"),
        ({"alphas": (float("nan"), 2.0)}, "alphas: cannot convert NaN"),
    ],
)
def test_a_false_claim_is_refused_with_its_reason(changes, reason):
    verdict = paper(**changes).verify()
    assert not verdict
    assert reason in verdict.why
    assert verdict.why.startswith("not certified")


def test_the_edge_is_sharp_to_the_last_digits():
    """Bisection to neighbouring floats: one is accepted, the next is refused, as the oracle says."""
    for field, inside, outside in [("lipschitz", 1.5, 1.6), ("mu", 3.55, 3.57), ("nu", 1400.0, 1200.0)]:
        while (middle := (inside + outside) / 2) not in (inside, outside):
            inside, outside = (middle, outside) if paper(**{field: middle}).verify() else (inside, middle)
        assert judged(paper(**{field: inside}))
        assert not judged(paper(**{field: outside}))


def test_round_trip_through_a_file_is_exact(tmp_path):
    rng = np.random.default_rng(3)
    for c in [paper(), *(random_certificate(rng) for _ in range(10))]:
        c.to_json(tmp_path / "c.json")
        loaded = certificates.load(tmp_path / "c.json")
        assert loaded == c
        assert loaded.verify() == c.verify()
        assert loaded.claim == c.claim


def written(path, changes=(), drop=(), resign=True):
    data = paper().to_dict() | dict(changes)
    if resign and not {"claim", "assumptions"} & set(changes):  # a careful forger writes the sentences of his numbers
        with contextlib.suppress(ValueError, OverflowError):
            hints = typing.get_type_hints(Condition5)
            forged = Condition5(**{f.name: base.decode(data[f.name], hints[f.name]) for f in dataclasses.fields(Condition5)})
            data |= {"claim": forged.claim, "assumptions": list(forged.assumptions)}
    data = {key: value for key, value in data.items() if key not in drop}
    if resign:
        data["sha256"] = checker.digest({key: value for key, value in data.items() if key != "sha256"})
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


@pytest.mark.parametrize("text", ["", "no", "[1, 2", "3", "null", "[]", "{}", '"jaxobs-cert/1"', "[" * 100_000, "9" * 5000])
def test_load_refuses_what_is_no_certificate(tmp_path, text):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"c\.json"):
        certificates.load(path)


def test_load_refuses_bytes(tmp_path):
    path = tmp_path / "c.json"
    path.write_bytes(b"\xff\xfe\x00{")
    with pytest.raises(ValueError, match="not JSON"):
        certificates.load(path)


@pytest.mark.parametrize(
    ("changes", "drop", "message"),
    [
        ({"format": "jaxobs-cert/2"}, (), "expected one written by"),
        ({"theorem": "condition6"}, (), "given theorem 'condition6'"),
        ({"theorem": ["condition5"]}, (), "given theorem"),
        ({}, ("theorem",), "given theorem None"),
        *(({}, (name,), f"given no '{name}'") for name in ("alphas", "gamma", "lipschitz", "n", "q", "mu", "nu")),
        *(({"gamma": wrong}, (), "gamma: ") for wrong in (6.0, 6, None, True, [], {}, "", "six", "0x1p5000", "1p", "0x")),
        *(
            ({"alphas": wrong}, (), "alphas: ")
            for wrong in ("0x1p1", [3.0, 2.0], ["0x1p1", None], {}, [["0x1p1"]], ["0x1p9999"])
        ),
        *(({name: wrong}, (), f"{name}: ") for name in ("n", "q") for wrong in ("2", 2.0, True, None, [2])),
        ({"assumptions": []}, (), "assumptions: given text of its own"),
        ({}, ("assumptions",), "assumptions: given text of its own"),
        ({"claim": "stable for every plant"}, (), "claim: given text of its own"),
    ],
)
def test_load_refuses_wrong_fields_even_with_a_right_hash(tmp_path, changes, drop, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        certificates.load(written(tmp_path / "c.json", changes, drop))


@pytest.mark.parametrize("key", ["claim", "gamma", "alphas", "assumptions", "n", "sha256", "extra"])
def test_load_refuses_damage(tmp_path, key):
    changed = {"n": 3, "alphas": [], "assumptions": []}.get(key, "0x1p3")
    with pytest.raises(ValueError, match="SHA-256"):
        certificates.load(written(tmp_path / "c.json", {key: changed}, resign=False))


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-0x1p3", "0x0p0", "0x0.0000000000001p-1022"])
@pytest.mark.parametrize("field", ["gamma", "lipschitz", "mu", "nu"])
def test_loaded_nonsense_does_not_hold(tmp_path, field, value):
    verdict = certificates.load(written(tmp_path / "c.json", {field: value})).verify()
    assert verdict.holds == (field == "lipschitz" and value.endswith("-1022"))


@pytest.mark.parametrize(("n", "q"), [(10**30, 0), (-1, 3), (2, 10**30), (3, -1)])
def test_loaded_sizes_that_do_not_fit_do_not_hold(tmp_path, n, q):
    assert not certificates.load(written(tmp_path / "c.json", {"n": n, "q": q})).verify()


EXTREME = (1e308, 5e-324, 1.0)


@pytest.mark.parametrize("alphas", [(1e308, 1e308), (5e-324, 5e-324), (1.0, 1e308), (1e308, 1.0), (3.0, 2.0), (-1e308, 1e308)])
def test_numbers_of_any_size_get_a_verdict(alphas):
    began = time.perf_counter()
    for gamma, rho, mu, nu in itertools.product(EXTREME, repeat=4):
        c = Condition5(alphas, gamma, rho, 2, 0, mu, nu)
        assert c.verify().holds == judged(c)
    assert time.perf_counter() - began < 10


def test_ten_extreme_alphas_finish_quickly():
    began = time.perf_counter()
    for value in EXTREME:
        c = Condition5((value,) * 10, 1e308, 5e-324, 10, 0, 5e-324, 1e308)
        assert not c.verify()
    assert time.perf_counter() - began < 10


def test_more_than_ten_alphas_are_refused_at_once():
    c = Condition5((1.0,) * 40, 1e200, 1.0, 40, 0, 1.0, 1.0)
    began = time.perf_counter()
    assert "alphas: 40 entries, expected 1 to 12" in c.verify().why
    assert time.perf_counter() - began < 1


def test_the_claim_holds_every_digit():
    """What is printed is what was verified: 1.5682665 is not 1.56827, which would be false."""
    assert "Lipschitz constant 1.5682665" in paper(lipschitz=1.5682665).claim
    assert paper(lipschitz=1.5682665).verify()
    assert not paper(lipschitz=1.56827).verify()
