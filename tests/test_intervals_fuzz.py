"""Enclosures against exact values in balls of 128 bits, over every plant and over programs of every kind."""

import importlib.util
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import intervals
from jaxobs.intervals import interval, table
from tests.interval_fuzz import Count, fuzz, fuzz_alone
from tests.interval_programs import ALONE, FURTHER, Program, of_plant, plant_names
from tests.oracles import ball_program

SLOW_BOXES, POINTS = 1200, 6
# Gathers and scatters are compiled for the reference: these are in the long run, and their rules in test_intervals_rules.py.
LONG = ("indexed", "written", "extremes", "sliced", "mixed", "table", "sorted", "chosen", "branches")


def program_of(name: str):
    return FURTHER[name] if name in FURTHER else of_plant(name)


@pytest.mark.parametrize("name", [*plant_names(), *(name for name in FURTHER if name not in LONG)])
def test_values_and_jacobian_lie_in_their_enclosures(name: str):
    count = fuzz(program_of(name), 12, 4, seed=0)
    assert count.violations == 0
    assert count.values > 100
    assert count.left_out <= 4


@pytest.mark.parametrize("name", list(ALONE))
def test_values_lie_in_their_enclosures_without_a_batch(name: str):
    count = fuzz_alone(ALONE[name], 10, 3, seed=0)
    assert count.violations == 0
    assert count.values >= 10 * 3


@pytest.mark.slow
def test_millions_of_values_lie_in_their_enclosures(capsys):
    total, worst = Count(), {}
    for name in [*plant_names(), *FURTHER]:
        count = fuzz(program_of(name), SLOW_BOXES, POINTS, seed=1)
        worst[name] = count.violations
        total = total.plus(count)
    with capsys.disabled():
        print(f"\n{total.values:,} values, {total.violations} outside, {total.left_out} points left out; {len(worst)} programs")
    assert {name: n for name, n in worst.items() if n} == {}
    assert total.values > 4_000_000
    assert total.left_out < 100


@pytest.mark.slow
@pytest.mark.parametrize("name", [*plant_names(), *FURTHER])
def test_the_reference_is_the_function(name: str):
    """The balls agree with JAX's own float64 values, of the function and of its Jacobian."""
    program = program_of(name)
    z = np.random.default_rng(3).uniform(program.low, program.high, (5, program.n))
    for f in (program.f, jax.jacfwd(program.f)):
        (exact,) = ball_program.evaluate(intervals.trace(jax.vmap(f), z).closed, z)
        np.testing.assert_allclose(exact.astype(float), jax.jit(jax.vmap(f))(z), rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_every_rule_is_exercised():
    """Each primitive of the table occurs in a program of the fuzz, with or without a batch."""
    seen: set[str] = set()

    def is_program(value):
        return hasattr(value, "eqns") or hasattr(value, "jaxpr")

    def walk(jaxpr):
        for eqn in jaxpr.eqns:
            seen.add(eqn.primitive.name)
            for inner in filter(is_program, jax.tree.leaves(list(eqn.params.values()), is_leaf=is_program)):
                walk(getattr(inner, "jaxpr", inner))

    for program in map(program_of, [*plant_names(), *FURTHER]):
        for f in (program.f, jax.jacfwd(program.f)):
            walk(intervals.trace(jax.vmap(f), np.ones((2, program.n))).closed.jaxpr)
    for program in ALONE.values():
        walk(intervals.trace(program.f, np.ones(program.n)).closed.jaxpr)
    assert seen - set(table.RULES) == set()
    assert set(table.RULES) - seen == {"closed_call", "core_call", "device_put"}  # wrappers that only other tools leave


def rounded_to_nearest(call, x, y):
    with np.errstate(invalid="ignore"):
        products = np.stack([a * b for a in (x.lower, x.upper) for b in (y.lower, y.upper)])
    products = np.where(np.isnan(products), 0.0, products)
    return interval.interval(products.min(0), products.max(0))


def without_crests(call, x):
    ends = np.sin(np.clip(x.lower, -9, 9)), np.sin(np.clip(x.upper, -9, 9))
    return interval.interval(np.minimum(*ends), np.maximum(*ends))


@pytest.mark.parametrize(("primitive", "wrong"), [("mul", rounded_to_nearest), ("sin", without_crests)])
def test_the_fuzz_finds_a_wrong_rule(monkeypatch, primitive, wrong):
    program = Program(lambda z: jnp.sin(z) * z[0], 3)
    assert fuzz(program, 100, 4, seed=0).violations == 0
    monkeypatch.setitem(table.RULES, primitive, wrong)
    assert fuzz(program, 100, 4, seed=0).violations > 0


def test_the_tightness_table_narrows_as_the_box_is_halved():
    path = Path(__file__).parent.parent / "benchmarks" / "tightness.py"
    spec = importlib.util.spec_from_file_location("tightness", path)
    assert spec is not None
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    benchmark.SAMPLES = 2000
    rows = benchmark.table(["Pendulum"])
    assert [name for name, _, _ in rows] == ["Pendulum"]
    for name, count, each in rows:
        assert count > 0
        worst = [most for _, most in filter(None, each)]
        assert len(worst) >= 3, name
        assert min(median for median, _ in filter(None, each)) >= 1 - 1e-9
        assert worst == sorted(worst, reverse=True)
    assert min(benchmark.nanoseconds_per_box(20, 2)) > 0
