"""Small certificates of every theorem, true by construction, with one number at the edge of truth: where mutations start.

Each is the body of a file: floats in hexadecimal, without claim, assumptions and hash.
"""

import numpy as np
from oracles import flint_certificates as oracle
from oracles import polynomial, riccati
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov, solve_discrete_lyapunov

SHIFT2, SHIFT3 = np.eye(2, k=1), np.eye(3, k=1)


def encoded(value):
    """As a file has it: lists of hexadecimal floats; integers and words as they are."""
    if isinstance(value, (int, str)):
        return value
    if isinstance(value, float):
        return float(value).hex()
    return [encoded(entry) for entry in (value.tolist() if isinstance(value, np.ndarray) else value)]


def body(theorem, **fields):
    return {"theorem": theorem} | {name: encoded(value) for name, value in fields.items()}


def at_the_edge(data, field, false, inside=1e-6):
    """The same with `field` moved towards the value `false`, where the claim is false, until only a share `inside` of the way
    from the last true value back to the first is left; true still."""
    start = low = float.fromhex(data[field])
    assert oracle.judge(data), data["theorem"]
    assert not oracle.judge(data | {field: float(false).hex()}), data["theorem"]
    high = float(false)
    for _ in range(26):
        middle = (low + high) / 2
        low, high = (middle, high) if oracle.judge(data | {field: middle.hex()}) else (low, middle)
    result = data | {field: (low + inside * (start - low)).hex()}
    assert oracle.judge(result), data["theorem"]
    return result


def lyapunov(f, q=None):
    """P with F'P + P F + q = 0."""
    p = solve_continuous_lyapunov(f.T, -np.eye(len(f)) if q is None else -q)
    return (p + p.T) / 2


def box(n=2, **changes):
    """The second or third derivative with one slope in a range, observed through the first state."""
    gain = {2: [[4.0], [5.0]], 3: [[6.0], [12.0], [9.0]]}[n]
    one = {
        "a": np.eye(n, k=1),
        "b": np.eye(n)[:, -1:],
        "c": np.eye(n)[:1],
        "lower": (-0.5,),
        "upper": (0.75,),
        "output": np.eye(1, n),
        "gain": gain,
        "tied": (),
        "inner": (),
    }
    return one | changes


def wide(**changes):
    """Three states, three channels two of which are tied, two outputs, an inner injection."""
    one = box(
        3,
        b=[[0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        c=[[0.25, 0.0, 1.0], [0.0, 0.5, 0.25], [0.0, 0.0, 0.25]],
        lower=(-0.75, -0.5, -0.75),
        upper=(0.5, 1.0, 0.5),
        output=[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        gain=[[5.0, 0.5], [6.0, 0.25], [1.0, 4.0]],
        tied=(0, 1, 0),
        inner=[[0.25, 0.0], [0.0, 0.125], [0.0, 0.0]],
    )
    return one | changes


def closed(one, rho=None):
    """F at rho, or in the middle of the box, in floats."""
    a, b, c, output, gain = (np.asarray(one[name], float) for name in ("a", "b", "c", "output", "gain"))
    rho = (np.asarray(one["lower"]) + one["upper"]) / 2 if rho is None else np.asarray(rho)
    inner = np.zeros((len(c), len(output))) if len(one["inner"]) == 0 else np.asarray(one["inner"])
    return a + b @ np.diag(rho) @ (c - inner @ output) - gain @ output


def without(one, *names):
    return {name: value for name, value in one.items() if name not in names}


def proved(theorem, one, p, **more):
    """A body of the theorems on P, Q or X with all their fields, those not given empty."""
    n = len(one["a"])
    full = dict.fromkeys(("left", "right", "taus"), ()) | {"tau": 0.0, "origin": "given"} | one | {"p": p}
    if theorem in ("h2", "l2"):
        full |= {"x": ()} if theorem == "h2" else {}
        full |= {"q": (), "taus_q": (), "weight": np.eye(n)[-1:], "process": 0.5 * np.eye(n)[:, -1:]}
        full |= {"noise": 0.25 * np.eye(len(one["output"]))}
    return body(theorem, **full | more)


def narrow(one, factor=0.125):
    return one | {name: tuple(factor * np.asarray(one[name])) for name in ("lower", "upper")}


def taus(one, p, factor=0.5):
    """The multipliers that balance P b_k and c_k."""
    slopes = (np.asarray(one["upper"]) - one["lower"]) / 2
    return factor * np.linalg.norm(p @ np.asarray(one["b"]), axis=0) / slopes


def decaying():
    for one in (box(), box(3, lower=(-0.5,), upper=(0.25,)), wide()):
        p = lyapunov(closed(one) + 0.25 * np.eye(len(one["a"])))
        yield at_the_edge(proved("corners", one, p, rate=0.0), "rate", 50.0)
        small = narrow(one)
        yield at_the_edge(proved("corners", small, p, taus=taus(small, p), rate=0.0), "rate", 50.0)
    small = narrow(wide(lower=(0.5, -0.5, 0.5), upper=(0.625, 1.0, 0.625)), 0.5)
    p = lyapunov(closed(small) + 0.25 * np.eye(3))
    yield at_the_edge(proved("corners", small, p, taus=taus(small, p) * [1, 0, 0], rate=0.0), "rate", 50.0)
    yield at_the_edge(proved("corners", small, p, taus=taus(small, p) * [0, 1, 0], rate=0.0), "rate", 50.0)
    chain = box(3) | {"b": [[], [], []], "c": (), "lower": (), "upper": ()}
    p = lyapunov(closed(box(3, lower=(0.0,), upper=(0.0,))) + 0.25 * np.eye(3))
    yield at_the_edge(proved("corners", chain, p, rate=0.0), "rate", 50.0)
    delta = {"left": np.eye(3)[:, -1:], "right": 0.125 * np.eye(3)[:1] + 0.0625 * np.eye(3)[-1:]}
    delta |= {"tau": float(np.linalg.norm(p[:, -1])) / 0.25}
    yield at_the_edge(proved("corners", chain, p, **delta, rate=0.0), "rate", 50.0)
    small = narrow(box(3))
    more = delta | {"left": np.eye(3)[:, 1:], "right": 0.0625 * np.eye(3)[:2]}
    yield at_the_edge(proved("corners", small, p, **more, rate=0.0), "rate", 50.0)


def stepping():
    for one, dt in ((box(), 0.125), (wide(), 0.0625)):
        n = len(one["a"])
        model = one | {"a": np.eye(n) + dt * np.asarray(one["a"]), "b": dt * np.asarray(one["b"])}
        model |= {"gain": dt * np.asarray(one["gain"])}
        p = solve_discrete_lyapunov((np.eye(n) + dt * closed(one)).T / 0.98, np.eye(n))
        p = (p + p.T) / 2
        yield at_the_edge(proved("step-corners", model, p, factor=1.0), "factor", 1e-3)
        small = narrow(model, 0.03125)
        yield at_the_edge(proved("step-corners", small, p, taus=taus(small, p), factor=1.0), "factor", 1e-3)
        delta = {"left": dt * np.eye(n)[:, -1:], "right": 0.0625 * np.eye(n)[:1], "tau": 16 * dt * float(p[-1, -1])}
        yield at_the_edge(proved("step-corners", small, p, **delta, factor=1.0), "factor", 1e-3)


def noisy():
    for one in (box(), wide()):
        n = len(one["a"])
        p = lyapunov(closed(one) + 0.25 * np.eye(n))
        for theorem in ("h2", "l2"):
            yield at_the_edge(proved(theorem, one, p, rate=0.125, q=8 * p, level=1e4), "level", 1e-6)
        covariance = 64 * lyapunov((closed(one) + 0.5 * np.eye(n)).T)
        yield at_the_edge(proved("h2", one, p, rate=0.125, x=covariance, level=1e4), "level", 1e-6)
        small = narrow(one | {"inner": ()})
        more = {"rate": 0.125, "q": 8 * p, "taus_q": taus(small, 8 * p), "taus": taus(small, p), "level": 1e4}
        delta = {"left": np.eye(n)[:, -1:], "right": 0.03125 * np.eye(n)[:1], "tau": float(p[-1, -1]) * 16}
        for theorem in ("h2", "l2"):
            yield at_the_edge(proved(theorem, small, p, **more), "level", 1e-6)
            yield at_the_edge(proved(theorem, small, p, **more | delta), "level", 1e-6)


def random_condition(rng):
    """The fields of condition (5) for a random size and gain, witnesses close to the edge, rho on either side of it."""
    size = int(rng.integers(1, 6))
    q = int(rng.integers(0, size))
    alphas = polynomial.spectral_factor(np.exp(rng.uniform(-1, 1, size)))
    gamma = float(10 ** rng.uniform(-0.3, 0.7))
    p, _ = riccati.solve(alphas, gamma)
    left, right = riccati.parts(alphas, gamma)
    rho = float(left / right * 10 ** rng.uniform(-0.3, 0.1))
    mu, nu = float(left * (1 - 1e-6)), float(np.linalg.eigvalsh(p)[-1] * (1 + 1e-6))
    return {"alphas": tuple(map(float, alphas)), "gamma": gamma, "lipschitz": rho, "n": size - q, "q": q, "mu": mu, "nu": nu}


def conditions():
    """Condition (5) and (44) at random sizes."""
    rng = np.random.default_rng(1)
    drawn = [body("condition5", **random_condition(rng)) for _ in range(12)]
    yield from (data for data in drawn if oracle.judge(data))


def high_gains():
    alphas, gamma = (3.0, 2.0), 6.0
    p, _ = riccati.solve(alphas, gamma)
    mu, nu = riccati.parts(alphas, gamma)[0] * (1 - 1e-6), np.linalg.eigvalsh(p)[-1] * (1 + 1e-6)
    for n, q in ((2, 0), (1, 1)):
        data = body("condition5", alphas=alphas, gamma=gamma, lipschitz=0.5, n=n, q=q, mu=float(mu), nu=float(nu))
        yield at_the_edge(data, "lipschitz", 9.0)
    k, theta, sigma = np.asarray([2.0, 1.5]), 4.0, 2.0
    p = lyapunov(SHIFT2 - np.outer(k, np.eye(2)[0]))
    nu = float(np.linalg.eigvalsh(p)[-1]) * 1.001
    for j0, lower, upper in (
        (0, (-0.25, -0.125), (0.125, 0.25)),
        (1, (-0.5, -0.25), (0.25, 0.125)),
        (2, (-0.5, 0.0), (0.5, 0.25)),
    ):
        constant = np.sqrt(sum(max(-lower[i], upper[i]) ** 2 * theta ** (2 * (i - 1 + j0)) for i in range(2 - j0)))
        numbers = {"gain": k * theta ** np.arange(1, 3), "theta": theta, "sigma": sigma, "j0": j0, "lower": lower}
        numbers |= {"upper": upper, "constant": float(constant) * (1 + 1e-9), "p": p, "nu": nu}
        yield at_the_edge(body("hg-lmi", **numbers | {"lam": 0.5 if j0 else 0.99}), "lam", 50.0)


def growing():
    one = without(box(lower=(-1.0,), upper=(7.0,)), "inner")
    yield body("frozen-instability", **one, rho=(5.0 + 2.0**-20,), step=0)
    oscillating = box(lower=(-4.0,), upper=(-0.25,), gain=[[-0.125], [0.0]])
    yield body("frozen-instability", **oscillating, rho=(-1.0,), step=0)
    step = wide(gain=[[-(2.0**-20), 0.0], [0.0, 0.0], [0.0, 0.5]], a=np.eye(3) + 0.25 * SHIFT3, inner=())
    yield body("frozen-instability", **step, rho=(0.25, 0.0, 0.25), step=1)
    damped = box(a=[[-0.125, 1.0], [0.0, -0.125]], lower=(-4.0,), upper=(-0.25,), gain=[[0.0], [0.0]])
    times = {"points": [[-4.0], [-0.25]], "durations": (np.pi / 4, np.pi), "repeats": 1, "step": 0, "scale": ()}
    yield body("switching-instability", **damped, **times)
    yield body("switching-instability", **damped, **times | {"repeats": 3, "durations": (0.75, 2.75)})
    dt = 0.25
    sampled = damped | {"a": np.eye(2) + dt * np.asarray([[-0.125, 1.0], [0.0, -0.125]]), "b": [[0.0], [dt]]}
    yield body(
        "switching-instability", **sampled, points=[[-4.0], [-0.25]], durations=(3.0, 12.0), repeats=2, step=1, scale=(1, -1)
    )


def absent():
    free = {"radius": 0.0, "t": 0.0}
    antistable = box(a=[[0.25, 1.0], [0.5, 0.125]], gain=[[0.5], [0.75]], lower=(-0.25,), upper=(0.25,))
    points = [[-0.25], [0.25]]
    multipliers = np.vstack([lyapunov(-(closed(antistable, rho) + 1.5 * np.eye(2)).T, np.eye(2)) for rho in points])
    data = body("no-gain", **antistable, points=points, multipliers=multipliers, rate=1.5, step=0, **free)
    yield at_the_edge(data, "rate", 0.0)
    data = body("no-gain", **antistable | {"gain": ()}, points=points, multipliers=multipliers, rate=1.5, step=0,
                radius=1e-3, t=8.0)  # fmt: skip
    yield at_the_edge(data, "radius", 50.0)
    blind = box(b=[[1.0], [0.0]], c=[[0.0, 1.0]], a=[[0.0, 0.0], [1.0, 0.25]], lower=(-1.0,), upper=(1.0,), gain=())
    twice = [[0.0, 0.0], [0.0, 1.0]] * 2
    yield body("no-gain", **blind, points=[[-1.0], [1.0]], multipliers=twice, rate=0.0, step=0, **free)
    steps = blind | {"a": [[0.5, 0.0], [1.0, 1.0625]], "b": [[0.0], [0.125]]}
    yield body("no-gain", **steps, points=[[0.0]], multipliers=[[0.0, 0.0], [0.0, 1.0]], rate=1.0, step=1, **free)
    hidden = without(box(3, a=[[-1.0, 0.0, 0.0], [0.5, -0.5, 2.0], [0.25, -2.0, -0.5]], b=[[1.0], [0.0], [0.0]],
                         c=[[0.0, 1.0, 0.5]]), "gain", "inner")  # fmt: skip
    yield body("undetectable", **hidden, rho=(0.0,), rate=0.5, step=0)
    yield body("undetectable", **hidden | {"a": [[0.5, 0.0, 0.0], [0.5, 0.5, 1.0], [0.25, -1.0, 0.5]]}, rho=(0.0,),
               rate=1.0, step=1)  # fmt: skip
    chain = without(box(3), "gain", "inner")
    f, output = np.eye(3, k=1) + 0.5 * np.outer(np.eye(3)[2], np.eye(3)[0]), np.eye(1, 3)
    process = np.diag([0.25, 0.5, 1.0])
    s = solve_continuous_are(f.T, output.T, 0.9 * process @ process, [[0.0625]])
    numbers = {"rho": (0.5,), "weight": np.eye(3)[-1:], "process": process, "noise": [[0.25]], "s": (s + s.T) / 2}
    yield at_the_edge(body("kalman-floor", **chain, **numbers, level=0.0), "level", 1e9)
    stiff = box(c=[[1.0, 0.0]], gain=(), lower=(2.0,), upper=(6.0,))
    floor = {"rate": 0.5, "points": [[6.0], [2.0]], "weights": (0.0, 1.0, 0.25, 0.0)}
    data = body("gain-floor", **without(stiff, "gain", "inner"), **floor, level=0.0)
    yield at_the_edge(data, "level", 1e3)
    numbers = {"theta": 2.0, "j0": 1, "lower": (-1.0, -8.0), "upper": (1.0, 8.0)}
    gain = np.asarray([2.0, 1.0])
    fs = [SHIFT2 - np.outer(gain, np.eye(2)[0]) + np.diag([0.0, psi / 2.0]) for psi in (-8.0, 8.0)]
    values, vectors = np.linalg.eigh(-sum(f + f.T for f in fs))
    w = vectors @ np.diag(np.maximum(values, 0) + 1e-3) @ vectors.T
    data = body("no-hg-lmi", gain=gain, **numbers, constant=100.0, multipliers=np.vstack([np.eye(2)] * 2), w=(w + w.T) / 2)
    yield at_the_edge(data, "constant", 1e-3)
    unseen = np.diag([0.0, 1.0])
    more = {"multipliers": np.vstack([0 * unseen, unseen]), "w": np.diag([0.125, 0.5])}
    yield at_the_edge(body("no-hg-lmi", gain=(), **numbers, constant=100.0, **more), "constant", 1e-3)


def beyond():
    for one in (box(), wide()):
        n, k = len(one["a"]), len(one["output"])
        p = lyapunov(closed(one) + 0.25 * np.eye(n))
        data = body("sampled", **one, p=p, w=100.0 * np.eye(k), delta=1e-4, rate=0.125, origin="given")
        yield at_the_edge(data, "delta", 5.0)
        delta, degree = 2.0**-16, 2
        start = np.linalg.inv(p)
        start = (start + start.T) / 2
        tube = [np.zeros((n + k, n + k)) for _ in range(degree)]
        for i, x in enumerate(tube, start=1):
            x[:n, :n], x[n:, n:] = start * (1 - 1e-9 * i), 0.5 * i * np.eye(k)
        data = body("sampled-tube", **one, start=start, tube=np.vstack(tube), delta=delta, rate=0.0, origin="given")
        yield at_the_edge(data, "rate", 50.0)
        sides = {"inner_lower": (-1.0, -2.0), "inner_upper": (1.0, 1.5), "outer_lower": (-3.0, -4.0), "outer_upper": (2.0, 4.0)}
        faces = np.eye(n)[:2] + 0.125 * np.eye(n)[-1:]
        numbers = sides | {"rate": 0.125, "faces": faces, "level": 1e-9, "radius": 1e-9}
        data = at_the_edge(proved("regional", one, p, **numbers), "level", 1e9)
        yield at_the_edge(data, "radius", 1e9)
        numbers = {"alpha": 0.25, "beta": 1e3, "gamma": 1e3, "disturbance": 0.5 * np.eye(n)[:, -1:], "size": 2.0**-7}
        numbers |= {"noise_size": 2.0**-8, "weight": np.eye(n)[-1:], "bound": 1e4}
        yield at_the_edge(proved("mismatch", one, p, **numbers), "bound", 1e-6)
        small = narrow(one | {"inner": ()})
        delta = {"left": np.eye(n)[:, -1:], "right": 0.03125 * np.eye(n)[:1], "tau": float(p[-1, -1]) * 2}
        yield at_the_edge(proved("mismatch", small, p, **numbers | delta, taus=taus(small, p)), "bound", 1e-6)


def seeds():
    """All of them."""
    groups = (decaying, stepping, noisy, conditions, high_gains, growing, absent, beyond)
    return [data for group in groups for data in group()]
