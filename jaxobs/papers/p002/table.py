"""Table I of paper 002, row by row: what the printed gains need, what any gain needs, and what reproduces the print."""

import numpy as np

from jaxobs.certificates import HighGainLmi, NoHighGainLmi
from jaxobs.designs import chain_lmi
from jaxobs.papers.claims import Bound, Point, Statement, Value, half_digit
from jaxobs.papers.p002 import shared
from jaxobs.papers.p002.paper import PAPER, TABLE, N, Printed


def _register(one: Printed) -> None:
    upper = sum(half_digit(one.theta))
    count = 2**one.j0
    slow = one.j0 * one.k_f >= 10 or one.j0 >= 2  # seconds each

    @PAPER.claim(f"{one.name} theta, all corners", "feasible", printed=one.theta, long=slow)
    def _():
        found = shared.needed(one)
        sharp = shared.needed(one, sharp=True)
        if one.j0 == 0:
            why = (
                f"(15)-(16) with the printed K and k_f hold from theta = {found.theta:.6g} on; with the sharp k_0(theta) the "
                f"same K needs only {sharp.theta:.6g}"
            )
        elif found.theta == float("inf"):
            why = "no theta will do for the printed K: A - K C has a pole in the right half plane, see the nominal poles"
        else:
            why = (
                f"P is not printed; with one P at all {count} corners of theorem 3.3 the printed K needs theta = "
                f"{found.theta:.6g} with the paper's k_j0 ({sharp.theta:.6g} with the sharp one)"
            )
        holds = found.theta <= upper
        if not holds and shared.refuted(one, True) is None:
            raise ArithmeticError(f"{one.name}: neither proved nor refuted")
        why += "" if holds else "; refuted at the printed theta in exact arithmetic"
        return Point(holds, found.theta if np.isfinite(found.theta) else None, why)

    @PAPER.claim(f"{one.name} smallest theta, printed k", "bound", printed=one.theta, long=slow)
    def _():
        return _attainable(one, sharp=False)

    @PAPER.claim(f"{one.name} smallest theta, sharp k", "bound", printed=one.theta, long=slow)
    def _():
        return _attainable(one, sharp=True)

    @PAPER.claim(f"{one.name} full box", "universal", printed="some P proves the error stable, as by theorem 3.3")
    def _():
        match shared.full_box(one):
            case HighGainLmi() as proof:
                rate = proof.verify().margins["decay_rate"]
                why = f"some P proves the printed L on all 2^{N} corners, at the rate {rate:.3g} /s"
                return Statement(
                    True, rate, why + ("" if shared.needed(one).theta <= upper else ", though not that of theorem 3.3")
                )
            case NoHighGainLmi():
                worst = shared.frozen(one)
                state = f"the worst of psi = 0 and the frozen corners has max Re = {worst:.4g} /s"
                why = (
                    "no common P exists for the printed L on the full box (exact proof), so neither theorem 3.3 nor LPV/LMI "
                    f"can prove it; {state}" + (", so stability as such is open" if worst < 0 else ": unstable there")
                )
                return Statement(False, worst, why)
        return Statement(None, "", "neither a proof nor a refutation was found")

    @PAPER.claim(f"{one.name} nominal poles", "universal", printed="A - K C is Hurwitz, by (31)")
    def _():
        worst = shared.nominal(one)
        why = "" if worst < 0 else (
            f"max Re(A - K C) = {worst:+.4f}, times theta {worst * float(one.theta):+.3f} /s: with the printed K the error of "
            "a plant with slopes 0, the middle of the box, grows. The printed theta does follow from this K at the corner of "
            "positive slopes alone, see the next row, so no digit seems lost"
        )  # fmt: skip
        return Statement(bool(worst < 0), worst, why)

    @PAPER.claim(f"{one.name} all-plus corner", "feasible", printed=one.theta)
    def _():
        found = shared.one_corner(one)
        where = (
            "no corners at j0 = 0"
            if one.j0 == 0
            else f"(31) at the corner psi = +k_f/5 alone (of {count}), sigma = {one.sigma}"
        )
        why = f"{where}: the printed K needs theta = {found:.6g}, which is how the printed value comes out"
        return Point(bool(found <= upper), found, why)

    if one.j0:

        @PAPER.claim(f"{one.name} n_LMI", "value", printed=one.lmis)
        def _():
            return Value(float(len(chain_lmi.corners(shared.bounds(one.k_f), one.j0, float(one.sigma)))))

        @PAPER.claim(f"{one.name} sigma", "feasible", printed=one.sigma)
        def _():
            rows = chain_lmi.corners(shared.bounds(one.k_f), one.j0, float(one.sigma))
            reach = chain_lmi.largest_lambda(rows)
            own = chain_lmi.largest_lambda(rows, np.array(one.gain)).attained
            why = (
                f"(31) has a solution at sigma = {one.sigma} (largest lam with P <= I: {reach.attained:.4g}); for the "
                "printed K " + (f"too ({own:.4g})" if own > 1e-9 else "none was found")
            )
            return Point(bool(reach.attained > 0), None, why)


def _attainable(one: Printed, sharp: bool) -> Bound:
    found = shared.smallest(one, sharp=sharp)
    constant = "the sharp k_j0(theta)" if sharp else f"k_j0 = {shared.printed_constant(one):.6g}"
    why = f"infimum over all K (not attained: K grows without bound) with {constant}, {2**one.j0} corners"
    if found.theta > float(one.theta):
        proof = shared.refuted(one, False, sharp=sharp)
        if proof is None:
            raise ArithmeticError(f"{one.name}: neither attained nor refuted")
        why += "; the printed theta is impossible for any K, by exact multipliers"
    return Bound(found.theta, "upper", why)


for _row in TABLE:
    _register(_row)
