"""Lemma 1 of paper 003: one gain and one Lyapunov function for a chain whose couplings vary but keep their signs."""

import dataclasses
import itertools

import numpy as np

from jaxobs._module import Numbers, refuse
from jaxobs.certificates import Corners
from jaxobs.designs import corner_lmi
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import Polytope, as_tuples

EXCESS = 1.1  # of the first gain over the one at which an inequality of the construction becomes singular


@dataclasses.dataclass(frozen=True)
class Lemma1:
    """gain K (n,) and p (n, n) with (A(a) - K C)'P + P (A(a) - K C) + 2 rate P < 0 for all a_i in [lower_i, upper_i].

    The paper's K has the other sign. certificate: the exact proof at all 2^{n-1} corners, for K and P as they are; its origin
    says so where only the proof in the coordinates d_i e_i (d (n,)), for d_i K_i before rounding, passes.
    """

    gain: np.ndarray
    p: np.ndarray
    d: np.ndarray
    certificate: Corners


def lemma1(lower: Numbers, upper: Numbers, *, rate: float | None = None) -> Lemma1:
    """K and P of lemma 1 for couplings of constant sign, lower_i <= a_i(t) <= upper_i (n - 1,), 0 outside.

    The inequality (6) is affine in a, so the corners are exact. Coordinates d_i e_i with d_{i+1} / d_i of the sign of a_i
    (and of its mean size) make all couplings positive and about 1. The quietest gain by `corner_lmi`; where that finds none
    (many states, wide couplings), the gain of the proof, `constructed`, which exists for all couplings but is far larger.
    rate [1/s]: of the decay, that of the slowest scaled coupling if not given.

    Infeasible, naming the entry, if an interval contains 0: a_i = 0 hides all states behind x_i, so that no K exists.
    """
    low, high = bounds_of(lower, upper)
    for i, (a, b) in enumerate(zip(low, high, strict=True), start=1):
        if a <= 0 <= b:
            reason = (
                f"0 lies in [{a:g}, {b:g}], the interval of a_{i}: with a_{i} = 0 nothing is seen of x_{i + 1}, so no K exists"
            )
            change = (
                f"Keep a_{i} away from zero, or take jaxobs.observers.Lyapunov and an input that passes excitation.classify."
            )
            raise Infeasible(reason, -min(-a, b), change)
    unit = np.sign(low) * np.sqrt(np.abs(low * high))
    d = np.concatenate([[1.0], np.cumprod(unit)])
    scaled_low, scaled_high = np.sort([low / unit, high / unit], axis=0)
    wanted = float(np.min(scaled_low, initial=1.0)) if rate is None else float(rate)
    model = chain_model(scaled_low, scaled_high)
    try:
        gain, certificate = corner_lmi.synthesise(model, rate=wanted, origin="given, in coordinates of unit couplings")
    except Infeasible:
        gain, certificate = _by_construction(model, wanted)
    assert isinstance(certificate, Corners)
    k, p = gain[:, 0] / d, np.asarray(certificate.p) * np.outer(d, d)
    carried = Corners(**chain_model(low, high).fields(), gain=as_tuples(k[:, None]), p=as_tuples(p), rate=wanted)
    return Lemma1(k, p, d, carried if carried.verify() else certificate)


def chain_model(lower: np.ndarray, upper: np.ndarray) -> Polytope:
    """e_i' = a_i e_{i+1} (i < n), e_n' = 0, with a_i in [lower_i, upper_i] [1/s] and e_1 measured (paper 003, lemma 1, (6)).

    lower, upper (n - 1,). ValueError, from Polytope: shapes that differ, numbers not finite, lower > upper, more than 12
    couplings.
    """
    n = len(lower) + 1
    return Polytope(np.zeros((n, n)), np.eye(n)[:, : n - 1], np.eye(n, k=1)[: n - 1], lower, upper, np.eye(1, n))


def constructed(lower: np.ndarray, upper: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """K and P of lemma 1 for positive couplings, without a solver, by induction from the last state to the first (n = len + 1).

    Let G = A - b M C be stable for the states behind e_1, with b = a_1 as the coefficient of its injection, P~ its Lyapunov
    matrix. Then k = k_1 (1, M) does it for the whole, in the coordinates (e_1, eta = e~ - M e_1), where for a coefficient b
    of the injection

        e_1' = a_1 C eta + (a_1 C M - b k_1) e_1,      eta' = G eta + G M e_1,

    with P = diag(s, P~) and any k_1 beyond the largest of (rate + a_1 C M + q'Q^-1 q / (2 s)) / b over the corners,
    Q = -(G'P~ + P~ G) - 2 rate P~, q = s a_1 C' + P~ G M; s is chosen to make it small. Source: the proof behind paper 003,
    lemma 1 (Gauthier and Kupka, 1994, lemma 2.1), with its constants.
    """
    pairs = [(1.0, 1.0), *zip(lower, upper, strict=True)]  # b, a_1, ..., a_{n-1}
    n = len(pairs)
    gain, p = np.asarray([EXCESS * n * rate / pairs[-1][0]]), np.eye(1)
    for stage in range(n - 2, -1, -1):
        inner, ranges = len(gain), [sorted({*pair}) for pair in pairs[stage:]]
        own = (stage + 1) * rate  # every stage leaves the next one some room
        parts = []
        for b, a, *rest in itertools.product(*ranges):
            c = np.eye(1, inner)
            g = np.diag(rest, 1) - a * np.outer(gain, c)
            room = -(g.T @ p + p @ g) - 2 * own * p
            parts.append((b, a, np.linalg.inv(room), p @ g @ gain, c[0]))

        def first(s: float, parts=parts, own=own, gain=gain) -> float:
            cost = [((s * a * c + w) @ inv @ (s * a * c + w) / (2 * s) + own + a * gain[0]) / b for b, a, inv, w, c in parts]
            return max(cost)

        s = float(min(np.geomspace(1e-6, 1e6, 241) * np.trace(p), key=first))
        k = EXCESS * first(s)
        t = np.eye(inner + 1)
        t[1:, 0] = -gain
        whole = np.block([[np.full((1, 1), s), np.zeros((1, inner))], [np.zeros((inner, 1)), p]])
        gain, p = k * np.concatenate([[1.0], gain]), t.T @ whole @ t
    return gain, (p + p.T) / (2 * np.max(np.abs(p)))


def _by_construction(model: Polytope, rate: float) -> tuple[np.ndarray, Corners]:
    gain, p = constructed(model.lower, model.upper, rate)
    origin = "given, in coordinates of unit couplings"
    certificate = Corners(**model.fields(), gain=as_tuples(gain[:, None]), p=as_tuples(p), rate=rate, origin=origin)
    verdict = certificate.verify()
    if not verdict:
        reason = f"neither the inequalities nor the construction of lemma 1 pass the exact check ({verdict.why})"
        raise Infeasible(reason, 0.0, "Narrow the couplings: the gain that the proof gives is beyond floats.")
    return gain[:, None], certificate


def bounds_of(lower: Numbers, upper: Numbers) -> tuple[np.ndarray, np.ndarray]:
    """Both as vectors. ValueError unless they are finite pairs, lowest <= highest."""
    low, high = (np.asarray(side, float).reshape(-1) for side in (lower, upper))
    if low.shape != high.shape or not np.all(np.isfinite([*low, *high])) or np.any(low > high):
        fix = "One pair for each coupling a_1, ..., a_{n-1}."
        raise refuse("triangular", "couplings", f"{low.tolist()} to {high.tolist()}", "finite pairs, lowest <= highest", fix)
    return low, high
