"""How far does each way of covering the box reach? Seconds of a design and of its exact check, chain of n = 2..12 states.

multiplier: one inequality of size n + k; lazy: corners added where the gain fails; corners: all 2^n of them. Noise and rate as
in the frontier of `jaxobs bench synthesis`. A cover stops at the first design beyond the budget.
Run: .venv/bin/python benchmarks/synthesis_growth.py [largest n] [budget in s] [cover ...]
"""

import sys

from jaxobs.bench.growth import BUDGET, COVERS, RATE, STRENGTH, growth, last_practical

LARGEST = int(sys.argv[1]) if len(sys.argv) > 1 else 12
LIMIT = float(sys.argv[2]) if len(sys.argv) > 2 else BUDGET
CHOSEN = [cover for cover in COVERS if len(sys.argv) <= 3 or cover in sys.argv[3:]]


def main() -> None:
    print(f"chain, k_f = {STRENGTH:g}, proved rate {RATE:g} /s; a budget of {LIMIT:g} s for a design")
    print(f"{'cover':>10} {'n':>3} {'corners':>8} {'design s':>9} {'check s':>8} {'guaranteed':>11}  verdict")
    rows = []
    for cover in CHOSEN:
        for one in growth(cover, range(2, LARGEST + 1), budget=LIMIT):
            rows.append(one)
            check = "" if one.check is None else f"{one.check:.2f}"
            level = "" if one.level is None else f"{one.level:.5g}"
            print(
                f"{cover:>10} {one.n:>3} {one.corners:>8} {one.design:>9.2f} {check:>8} {level:>11}  {one.verdict}", flush=True
            )
    for cover in CHOSEN:
        print(f"{cover}: practical up to n = {last_practical(rows, cover, LIMIT)}")


if __name__ == "__main__":
    main()
