"""Bad arguments of a study: each is named, with what to try, before anything is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from study_cases import FAMILY, GIVEN, KEYS, NEEDED, OBSERVER, PLANT, groups

import jaxobs
from jaxobs import Seeds, grid, integrators, metrics, noise, observers, plants, study, variants
from jaxobs.studies.groups import check_names

LABELS = {"one": FAMILY, "two": grid(OBSERVER, gamma=[2.0, 4.0])}
REFUSED = [
    ({"keys": None, "noise": noise.Gaussian(0.1)}, r"study\.keys: given None; expected Seeds.*jaxobs\.Seeds\("),
    ({"keys": jax.random.key(0)}, r"study\.keys: given .*of shape \(\)"),
    ({"keys": 3}, r"study\.keys: given int of shape \(\)"),
    ({"keys": Seeds(jax.random.key(0, impl="rbg"), 3)}, r"study\.keys: given keys of the kind '\w*rbg'.*threefry2x32"),
    ({"keys": jax.random.split(jax.random.key(0), (2, 2))}, r"study\.keys: given .*of shape \(2, 2\)"),
    ({"families": LABELS}, r"study\.families: given gamma with values \[2\.0, 4\.0\] at observer = 'two'; .*study them apart"),
    ({"families": {"one": FAMILY, "two": OBSERVER}}, r"families: given axes \[\] at observer = 'two'; expected the axes"),
    ({"families": {}}, r"study\.families: given no values; expected at least one"),
    ({"families": 3}, r"study\.families: given int; expected an observer or a family.*jaxobs\.variants"),
    ({"families": {"one": 3}}, r"study\.observer: given int 3"),
    ({"families": variants(lambda time: FAMILY, time=[1, 2])}, r"study\.families: given an axis 'time'"),
    ({"families": variants(lambda q: (PLANT, FAMILY), q=[1])}, r"study\.plant: given a plant beside variants"),
    ({"plant": None}, r"study\.plant: given NoneType None"),
    ({"plant": plants.IntegratorChain(3), "x0": [1, 0, 0]}, r"study\.observer: given n = 2 states; expected the plant's n = 3"),
    ({"families": jaxobs.astype(FAMILY, jnp.float32)}, r"study\.plant: given precision float64; expected the observer's"),
    ({"metrics": {"x0": metrics.RMSE()}}, r"study\.metrics: given the name 'x0'"),
    ({"metrics": {"gamma": metrics.RMSE()}}, r"study\.metrics: given the name 'gamma'"),
    ({"metrics": {"a/b": metrics.RMSE()}}, r"study\.metrics: given the name 'a/b'"),
    ({"metrics": metrics.RMSE()}, r"study\.metrics: given RMSE"),
    ({"metrics": {"rmse": metrics.RMSE}}, r"study\.metrics\['rmse'\]: given the class RMSE"),
    ({"metrics": {"diverged_at": metrics.RMSE()}}, r"study\.metrics: given the name 'diverged_at'"),
    ({"x0": [[0.5, 0.0], [np.nan, 0.0]]}, r"study\.x0: given \[nan +0\.\]; expected finite"),
    ({"x0": [[0.5, 0.0], [0.5]]}, r"study\.x0: given \[\[0\.5, 0\.0\], \[0\.5\]\]; expected real numbers"),
    ({"x0": "rest"}, r"study\.x0: given 'rest'"),
    ({"x0": None}, r"study\.x0: given .*; expected"),
    ({"x0": [0.5]}, r"study\.x0: given shape \(1,\); expected \(2,\)"),
    ({"xhat0": [[0.5]]}, r"study\.xhat0: given shape \(1,\); expected \(2,\)"),
    ({"xhat0": np.zeros((0, 2))}, r"study\.xhat0: given shape \(0, 2\); expected \(2,\)"),
    ({"ts": [0.0, 0.1, 0.1]}, r"study\.ts: given ts\[2\] = 0\.1 after ts\[1\] = 0\.1"),
    ({"save": 0}, r"study\.save: given 0; expected an integer >= 1"),
    ({"save": 2.0}, r"study\.save: given 2\.0"),
    ({"chunk": 0}, r"study\.chunk: given 0; expected an integer >= 1"),
    ({"tile": None}, r"study\.tile: given None; expected an integer >= 1"),
    ({"budget": -1}, r"study\.budget: given -1"),
    ({"budget": 10}, r"study\.budget: given 10 bytes \(given\); expected the \d+ bytes of one lane or more"),
    ({"part": (2, 2)}, r"study\.part: given \(2, 2\); expected \(i, count\) with 0 <= i < count"),
    ({"part": 1}, r"study\.part: given 1"),
    ({"progress": 3}, r"study\.progress: given 3; expected None, True, a function or a progress meter"),
    ({"hold_innovation": 1}, r"study\.hold_innovation: given 1; expected True or False"),
    ({"integrator": "RK4"}, r"study\.integrator: given str 'RK4'"),
    ({"noise": grid(OBSERVER, gamma=[1.0]), "keys": KEYS}, r"study\.noise: given HighGain"),
]  # fmt: skip


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(("change", "message"), REFUSED, ids=lambda v: "" if isinstance(v, dict) else v[:40])
def test_refused_before_anything_is_compiled(change, message, monkeypatch):
    monkeypatch.setattr("jaxobs.studies.montecarlo.compile_group", pytest.fail)
    given = (
        {"plant": PLANT, "families": FAMILY, "keys": None} | {n: GIVEN[n] for n in ("ts", "metrics", "x0", "xhat0")} | change
    )
    with pytest.raises(ValueError, match=message):
        study(given.pop("plant"), given.pop("families"), **given)


def test_traced_numbers_are_refused():
    def total(gamma):
        family = grid(OBSERVER, gamma=gamma[None])
        return jnp.sum(jnp.asarray(study(PLANT, family, **NEEDED).rmse.values))

    with pytest.raises(ValueError, match=r"study\.observer: given values that are being traced.*jaxobs\.over"):
        jax.grad(total)(jnp.asarray(2.0))


def test_results_that_memory_cannot_hold_need_a_store(monkeypatch):
    monkeypatch.setattr("jaxobs.studies.montecarlo.free_memory", lambda: 1000)
    with pytest.raises(ValueError, match=r"study\.store: given None; expected a folder for .* GiB of results"):
        study(PLANT, FAMILY, keys=Seeds(jax.random.key(0), 1000), **NEEDED)


def test_no_axis_twice():
    with pytest.raises(ValueError, match=r"study\.families: given the axis 'plant\.a' twice"):
        check_names({}, ("plant.a", "seed", "plant.a"))


def test_each_member_meets_the_sampling_period():
    step = plants.Discretised(PLANT, integrators.Euler(), 0.1)
    family = grid(observers.StepLuenberger(step, [[0.4], [0.3]]), **{"model.dt": [0.1, 0.2]})
    with pytest.raises(ValueError, match=r"study\.ts: given samples 0\.1 s apart; expected Discretised\.dt = 0\.2 s"):
        groups(PLANT, family)


def test_one_warning_for_all_members_that_are_too_fast():
    family = grid(OBSERVER, gamma=[2.0, 100.0, 200.0, 300.0])
    with pytest.warns(
        jaxobs.integrators.limits.UnstableStep, match=r"study: steps of 0\.1 s.*The same holds for 2 more"
    ) as caught:
        groups(PLANT, family)
    assert len(caught) == 1


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("axes", "message"),
    [
        ({}, r"variants\.axes: given none"),
        ({"q": []}, r"variants\.q: given no values"),
        ({"q": 2}, r"variants\.q: given 2; expected a list of values. Give a list: q=\[2\]"),
        ({"q": "ab"}, r"variants\.q: given 'ab'"),
        ({"q": [0, 0]}, r"variants\.q: given \[0, 0\]; expected each value once"),
        ({"q": [0, "a"]}, r"variants\.q: given \[0, 'a'\]; expected numbers, or strings"),
        ({"a/b": [1]}, r"variants\.axes: given the name 'a/b'; expected a Python name"),
        ({"q": [None]}, r"variants\.q: given \[None\]"),
    ],
)
def test_variants_refused(axes, message):
    with pytest.raises(ValueError, match=message):
        variants(lambda **point: FAMILY, **axes)
    with pytest.raises(ValueError, match=r"variants\.make: given HighGain; expected a function"):
        variants(OBSERVER, q=[1])


def test_an_error_in_a_variant_says_where():
    def make(q):
        return observers.HighGain(PLANT, [1.0] * q, 3.0)

    with pytest.raises(ValueError, match=r"HighGain\.alphas") as caught:
        groups(PLANT, variants(make, q=[2, 3]))
    assert caught.value.__notes__ == ["It came from variants(make, ...) at q=3."]


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [((0, 3), r"Seeds\.key: given int"), ((jax.random.split(jax.random.key(0)), 3), r"Seeds\.key"),
     ((jax.random.key(0), 0), r"Seeds\.count: given 0; expected an integer >= 1"),
     ((jax.random.key(0), 2**33), r"Seeds\.count: given 8589934592; expected at most 2\*\*32 seeds")],
)  # fmt: skip
def test_seeds_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Seeds(*arguments)
