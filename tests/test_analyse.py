"""What `analyse` proves of a gain, against closed forms, and next to what constant parameters allow."""

import numpy as np
import pytest
from oracles import levels

from jaxobs.designs import Analysis, analyse
from jaxobs.designs.polytope import Polytope
from jaxobs.plants import Pendulum


def chain(n: int, slope: float) -> Polytope:
    column, bound = np.eye(n)[:, -1:], np.full(n, slope)
    return Polytope(np.eye(n, k=1), np.tile(column, (1, n)), np.eye(n), -bound, bound, np.eye(1, n))


@pytest.fixture(scope="module")
def found() -> Analysis:
    return analyse(
        chain(2, 0.5), np.array([[4.0], [5.0]]), region=((-np.ones(2), np.ones(2)), (-3 * np.ones(2), 3 * np.ones(2)))
    )


def test_one_state_in_closed_form():
    """e' = (rho - 3) e + w - 3 v, |rho| <= 1/2: rate 2.5, variance (1 + 9) / 5, energy gain sqrt(10) / 2.5."""
    one = analyse(Polytope(*(np.array(x) for x in ([[0.0]], [[1.0]], [[1.0]], [-0.5], [0.5], [[1.0]]))), [[3.0]])
    assert one.rate == pytest.approx(2.5, rel=2e-4)
    assert one.h2 == pytest.approx(np.sqrt(2), rel=1e-5)
    assert one.l2 == pytest.approx(np.sqrt(10) / 2.5, rel=1e-5)
    assert one.frozen_rate == pytest.approx(2.5)
    assert one.frozen_h2 == pytest.approx(np.sqrt(2))


def test_everything_is_certified_and_within_the_frozen_limits(found):
    assert set(found.certificates) == {"rate", "h2", "l2", "region"}
    for certificate in found.certificates.values():
        assert certificate.verify()
    assert 0 < found.rate <= found.frozen_rate
    assert found.h2 >= found.frozen_h2 >= np.sqrt(levels.frozen(found.certificates["h2"])) * (1 - 1e-9)
    assert found.l2 >= levels.peak_gain(found.certificates["l2"])
    assert 0 < found.radius <= 2  # from a state in |x_j| <= 1, with an estimate in |z_j| <= 3


def test_multiplier_is_never_the_better_rung(found):
    multiplier, corners = found.rungs
    assert (multiplier.name, corners.name) == ("multiplier", "corners")
    assert multiplier.rate <= corners.rate * (1 + 1e-4)
    assert multiplier.h2 >= corners.h2 * (1 - 1e-4)
    assert multiplier.l2 >= corners.l2 * (1 - 1e-4)


def test_it_prints_a_table(found):
    text = str(found)
    assert text.splitlines()[0].split() == ["proof", "rate", "1/s", "H2", "L2", "s"]
    assert f"{found.frozen_rate:.5g}" in text
    assert "certificates: rate, h2, l2, region" in text


def test_nothing_proved_is_none_not_unstable():
    weak = analyse(chain(2, 0.5), np.array([[0.1], [0.1]]))
    assert (weak.rate, weak.h2, weak.l2, weak.radius) == (None, None, None, None)
    assert weak.certificates == {}
    assert "unstable" not in str(weak)
    assert "certificates: none" in str(weak)


def test_ladder_of_a_chain():
    """The pendulum with |u| <= 1/2: |phi's slope along x_1| <= sqrt(1.25). Its own proofs at this gain are added."""
    k = float(np.sqrt(1.25))
    model = Polytope(np.eye(2, k=1), np.eye(2)[:, -1:], np.eye(1, 2), np.array([-k]), np.array([k]), np.eye(1, 2))
    gain = np.array([[4.5], [4.5]])
    found = analyse(model, gain, plant=Pendulum(), lipschitz=k, covers=("lazy",))
    proofs = {rung.name: rung.certificate is not None for rung in found.chain}
    names = ("condition (5)", "S-lemma, same P", "S-lemma, free P", "structure", "box corners", "output injection")
    assert tuple(proofs) == names
    assert list(proofs.values()) == sorted(proofs.values())  # the more is known, the more is proved
    assert not proofs["condition (5)"]
    assert proofs["structure"]
    assert "condition (5): not certified" in str(found)
    with pytest.raises(ValueError, match=r"analyse.plant: given .* lipschitz = None"):
        analyse(model, gain, plant=Pendulum())
