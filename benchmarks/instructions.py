"""Where does the time of a lane-step go? The instructions that jaxobs and the C reference execute, counted one by one.

Both are compiled for AVX2, the widest that valgrind knows, and run once under callgrind, which counts every instruction that is
executed. What the compiler of JAX leaves as object files, and the library of the C, are disassembled: an executed address
belongs to the code whose instructions it falls on. Counts are per lane-step of the step's own code, the rest of the process
left out. The time next to them is taken without valgrind, of the same code on all cores, round after round. For AVX2 GCC leaves
the generator of the C in double precision scalar: with noise, and at the machine's own width, the race is the comparison.
Run: python benchmarks/instructions.py [--precision float32] [--sigma 0] (needs gcc, objdump and valgrind)
"""

import argparse
import collections
import dataclasses
import re
import shutil
import statistics
import sys
import tempfile
from pathlib import Path

from _c import DTYPES, NoCompiler, build, disassembled
from _contenders import CORES, Contender, Entry
from _job import Job

ISA = "x86-64-v3"
WAYS = {
    "C": Contender("C", "_rival_c"),
    "jaxobs": Contender(
        "jaxobs", "_rival_jaxobs", environment=(("RACE_PART", "loop"), ("XLA_FLAGS", "--xla_cpu_max_isa=AVX2"))
    ),
}
KINDS = {
    "arithmetic": r"vf?n?m?(add|sub|mul|div|sqrt|max|min|round|cmp|and|or|xor|blend|cvt|p?s[lr]l|padd|psub|pmul|pxor|por|pand)",
    "moves of vectors": r"v",
    "addresses, loops, checks": r"",
}
ROUNDS = 9


@dataclasses.dataclass(frozen=True)
class Count:
    """Instructions per lane-step by kind, and the most frequent operations."""

    kinds: dict[str, float]
    operations: dict[str, float]

    @property
    def total(self) -> float:
        return sum(self.kinds.values())


def executed(path: Path) -> dict[str, collections.Counter[int]]:
    """{object: {address: how often callgrind saw it}}; code compiled on the way has an object without a name, "???"."""
    counts: dict[str, collections.Counter[int]] = collections.defaultdict(collections.Counter)
    called, where = False, "???"
    for line in path.read_text().splitlines():
        if line.startswith("ob="):
            where = line[3:]
        elif line.startswith("calls="):
            called = True  # the next line has what the callee cost
        elif found := re.match(r"(0x[0-9a-f]+) \S+ (\d+)$", line):
            if not called:
                counts[where][int(found[1], 16)] += int(found[2])
            called = False
    return counts


def placed(code: dict[int, str], counts: collections.Counter[int]) -> dict[int, int]:
    """{address that was executed: offset in the code} where the code was loaded, empty if it was not.

    Code is loaded in pages, and every address that was executed within it is the start of an instruction.
    """
    votes: collections.Counter[int] = collections.Counter()
    pages = collections.defaultdict(list)
    for offset in code:
        pages[offset % 4096].append(offset)
    for address, count in counts.most_common(20_000):
        for offset in pages[address % 4096]:
            votes[address - offset] += count
    low, high = min(code), max(code)
    for base, _ in votes.most_common(200):
        within = [address for address in counts if low <= address - base <= high]
        if all(address - base in code for address in within):
            return {address: address - base for address in within}
    return {}


def count(way: Contender, job: Job, folder: Path) -> Count:
    """One contender under callgrind: the study once to compile it, once more."""
    dump, callgrind = folder / "dump", folder / "callgrind.out"
    shutil.rmtree(dump, ignore_errors=True)
    tool = [
        "valgrind",
        "--tool=callgrind",
        "--dump-instr=yes",
        "--compress-pos=no",
        "--compress-strings=no",
        "--smc-check=all-non-file",
    ]
    given = dict(way.environment)
    given["XLA_FLAGS"] = f"{given.get('XLA_FLAGS', '')} --xla_dump_to={dump}".strip()
    way = dataclasses.replace(way, environment=tuple(given.items()))
    entry = Entry(way, job.precision, folder, (*tool, f"--callgrind-out-file={callgrind}"), patience=1200.0)
    try:
        entry.prepare(job)
        entry.ask("run", 1)
    finally:
        entry.close()
    codes = sorted(dump.glob("*spread*.o")) if dump.exists() else [folder / f"{job.workload}-{job.precision}-vector.so"]
    seen = executed(callgrind)
    counts = seen["???" if dump.exists() else str(codes[0])]
    kinds: collections.Counter[str] = collections.Counter()
    operations: collections.Counter[str] = collections.Counter()
    for code in sorted(map(disassembled, codes), key=len, reverse=True):
        for address, offset in placed(code, counts).items():
            operations[code[offset]] += counts.pop(address)
    for operation, times in operations.items():
        kinds[next(kind for kind, pattern in KINDS.items() if re.match(pattern, operation))] += times
    work = 2 * job.lanes * job.steps
    return Count(
        {kind: kinds[kind] / work for kind in KINDS}, {name: times / work for name, times in operations.most_common(12)}
    )


def timed(job: Job, folder: Path) -> dict[str, list[float]]:
    """ns per lane-step of both, round after round, without valgrind."""
    entries = {name: Entry(way, job.precision, folder) for name, way in WAYS.items()}
    times: dict[str, list[float]] = {name: [] for name in WAYS}
    try:
        for entry in entries.values():
            entry.prepare(job)
        for _ in range(ROUNDS):
            for name, entry in entries.items():
                times[name].append(entry.ask("run", 20)["seconds"] / (job.lanes * job.steps) * 1e9)
    finally:
        for entry in entries.values():
            entry.close()
    return times


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--precision", choices=list(DTYPES), nargs="+", default=["float32"])
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0], help="of the noise; 0: none")
    parser.add_argument("--lanes", type=int, default=4096)
    parser.add_argument("--steps", type=int, default=1000)
    options = parser.parse_args()
    missing = [tool for tool in ("valgrind", "objdump") if shutil.which(tool) is None]
    if missing:
        print(f"missing on the path: {', '.join(missing)}")
        return 1
    for precision in options.precision:
        for sigma in options.sigma:
            job = Job("pendulum", precision, sigma, options.lanes, options.steps)
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                try:
                    build(folder, precision, march=ISA)
                except NoCompiler as error:
                    print(error)
                    return 1
                times = timed(job, folder)
                counts = {label: count(way, job, folder) for label, way in WAYS.items()}
            show(job, counts, times)
    return 0


def show(job: Job, counts: dict[str, Count], times: dict[str, list[float]]) -> None:
    noise = f"noise {job.sigma:g}" if job.sigma else "no noise"
    print(f"\npendulum, {job.precision}, {noise}, {job.lanes:,} lanes x {job.steps:,} steps, AVX2; per lane-step")
    print(f"{'':28}" + "".join(f"{label:>12}" for label in counts) + f"{'ratio':>9}")
    rows = {kind: [one.kinds[kind] for one in counts.values()] for kind in KINDS}
    rows["instructions"] = [one.total for one in counts.values()]
    rows[f"ns, {CORES} cores"] = [statistics.median(times[label]) for label in counts]
    for label, (c, ours) in rows.items():
        print(f"{label:28}{c:12.4g}{ours:12.4g}{ours / c:9.2f}")
    for label, one in counts.items():
        print(f"{label}: " + ", ".join(f"{name} {value:.2g}" for name, value in one.operations.items()), flush=True)


if __name__ == "__main__":
    sys.exit(main())
