"""Is the C reference right? Its generator by known answers, its normals by their moments, its functions against NumPy's."""

import numpy as np
from _c import Reference

# counter, key, words: the known answers of Threefry-2x32 with 20 rounds in the Random123 distribution
ONES = 0xFFFFFFFF
KNOWN = (
    ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
    ((ONES, ONES), (ONES, ONES), (0x1CB996FC, 0xBB002BE7)),
    ((0x243F6A88, 0x85A308D3), (0x13198A2E, 0x03707344), (0xC4923A9C, 0x483DF7A0)),
)
MOMENTS = {1: (0, 1), 2: (1, 2), 3: (0, 15), 4: (3, 96)}  # order: mean of z^order and variance of that power
DRAWS, Z_LIMIT = 4_000_000, 4.5
ULPS = 3.0  # of 1 for sin and cos (their error is absolute), of the value for log


def verify(reference: Reference) -> tuple[str, list[str]]:
    """(what was found, what is wrong)."""
    wrong = [f"the generator of the C at {c}, {k}" for c, k, answer in KNOWN if reference.words(c, k) != answer]
    lanes = reference.normals(1, 0).shape[2]
    drawn = reference.normals(DRAWS // (2 * lanes), 1).astype(np.float64)
    count = drawn.size
    scores = {f"moment {m}": (np.mean(drawn**m) - mean) / np.sqrt(var / count) for m, (mean, var) in MOMENTS.items()}
    neighbours = {
        "in a pair": (drawn[:, 0], drawn[:, 1]),
        "in time": (drawn[1:, 0], drawn[:-1, 1]),
        "of lanes": (drawn[..., 1:], drawn[..., :-1]),
    }
    scores |= {f"correlation {name}": np.sum(a * b) / np.sqrt(a.size) for name, (a, b) in neighbours.items()}
    wrong += [f"{name} of the C's normals, z = {z:.1f}" for name, z in scores.items() if not abs(z) < Z_LIMIT]
    errors = errors_of(reference)
    wrong += [f"{name} of the C, {e:.1f} units in the last place" for name, e in errors.items() if not e < ULPS]
    worst = max(scores.values(), key=abs)
    found = ", ".join(f"{name} {e:.2g}" for name, e in errors.items())
    return f"{len(KNOWN)} known answers, {count:,} normals with |z| <= {abs(worst):.1f}, errors in ulp: {found}", wrong


def errors_of(reference: Reference) -> dict[str, float]:
    """The largest errors of sin and cos on [-100, 100] and of log on [1e-9, 1], in units of the last place."""
    eps = float(np.finfo(reference.dtype).eps)
    x = np.linspace(-100, 100, 1_000_001).astype(reference.dtype)
    u = np.geomspace(1e-9, 1, 500_001).astype(reference.dtype)
    sines, cosines, _ = reference.functions(x)
    logarithms = reference.functions(u)[2]
    exact = np.log(u.astype(np.longdouble))
    size = np.maximum(np.abs(exact), np.finfo(np.longdouble).tiny)
    return {
        "sin": float(np.max(np.abs(sines - np.sin(x.astype(np.longdouble))))) / eps,
        "cos": float(np.max(np.abs(cosines - np.cos(x.astype(np.longdouble))))) / eps,
        "log": float(np.max(np.abs(logarithms - exact) / size)) / eps,
    }
