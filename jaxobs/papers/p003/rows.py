"""The ten inputs: what `classify` says of each, and what the three observers do with it."""

from jaxobs.papers.claims import Statement
from jaxobs.papers.p003.inputs import INPUTS
from jaxobs.papers.p003.paper import PAPER
from jaxobs.papers.p003.runs import CONVERGED, END, GROWTH, THETA, all_errors, classified

PRINTED = {"cos t": "in C_SP, not in C_LR (example 1)"}


def _classify(name: str):
    def compute():
        found = classified(name)
        verdicts = {
            "LR": found.locally_regular, "i)": found.comparable, "ii)": found.ordered, "iii)": found.lasting,
        }  # fmt: skip
        ours = ", ".join(f"{key} {'yes' if value else 'no'}" for key, value in verdicts.items())
        # Remark 2, and example 1 where it is printed.
        holds = found.strongly_persistent or not found.locally_regular
        if name in PRINTED:
            holds = found.strongly_persistent and not found.locally_regular
        return Statement(holds, ours, found.why)

    PAPER.claim(f"u = {name}: classify", "figure", printed=PRINTED.get(name, "(C_LR in C_SP, remark 2)"))(compute)


def _observers(name: str):
    def compute():
        found, errors, growing = classified(name), all_errors()[name], all_errors(True)[name]
        predicted = (not found.constant_gain or errors.constant < CONVERGED) and (
            not found.persistent or (errors.fading < CONVERGED and growing.fading < CONVERGED)
        )
        same = abs(errors.scaled) < CONVERGED if errors.fading < CONVERGED else errors.scaled > CONVERGED
        ours = f"(7) {errors.constant:.2g}, (12) {errors.scaled:.2g}, (25) {errors.fading:.2g}"
        why = (
            f"|e({END:g})| / |e(0)| on example 1 at theta = {THETA:g}; with x2' = {GROWTH:g} x2: (7) {growing.constant:.2g}, "
            f"(12) {growing.scaled:.2g}, (25) {growing.fading:.2g}. Proposition 1 "
            f"{'allows' if found.constant_gain else 'does not cover'} the constant gain; conditions i) to iii) "
            f"{'hold' if found.persistent else 'do not all hold'} on the grid"
        )
        return Statement(predicted and same, ours, why)

    PAPER.claim(f"u = {name}: three observers", "figure", printed="(as proposition 1, theorem 3 say)", long=True)(compute)


for _name in INPUTS:
    _classify(_name)
    _observers(_name)
