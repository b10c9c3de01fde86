"""The paper prints no figures; these are ours, of what it speaks of."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._simulate import simulate
from jaxobs.designs.tracker import equal_bandwidth, equal_bias, relative_white, response
from jaxobs.designs.tracker_bounds import peak, transition, transition_steady
from jaxobs.noise import Gaussian
from jaxobs.observers import Algebraic, DuffingRational, DuffingRoot
from jaxobs.papers.p001.paper import tracker as make_tracker
from jaxobs.papers.pictures import Line, Panel, Picture
from jaxobs.plants import Duffing


def peaking() -> Picture:
    n, q, mu = 3, 1, 60.0
    ts = np.geomspace(1e-4, 2.0, 300)
    starts = {"H(0) = I": 1.0, "H(0) = diag(1, 1, 1, 1e-4)": np.asarray([1.0, 1.0, 1.0, 1e-4])}
    lines = [Line(name, ts, [np.linalg.norm(transition(n, q, mu, start, t), 2) for t in ts]) for name, start in starts.items()]
    lines.append(Line("H(0) = H_inf", ts, [np.linalg.norm(transition_steady(n, q, mu, t), 2) for t in ts], "--"))
    rates = np.geomspace(5, 1000, 16)
    found = {name: [peak(n, q, mu, start) for mu in rates] for name, start in starts.items()}
    peaks = [Line(name, rates, [one.value for one in row]) for name, row in found.items()]
    peaks += [Line(f"bound, {name}", rates, [one.bound for one in row], ":", True) for name, row in found.items()]
    peaks.append(Line("H(0) = H_inf", rates, [peak(n, q, mu, None).value for mu in rates], "--"))
    return Picture(
        "001_peaking",
        "Ours: n = 3, q = 1; left mu = 60. The gain that opens gently does not peak, whatever mu; the steady one does like "
        "mu^3.",
        (
            Panel("How far the state may swing", "t [s]", "||Phi(t)||", tuple(lines), "log", "log"),
            Panel("Peaks", "mu [1/s]", "sup ||Phi||", tuple(peaks), "log", "log"),
        ),
    )


def noise() -> Picture:
    omega, n = np.geomspace(0.05, 100, 200), 3
    tones = []
    for q in range(4):
        ratio = equal_bias(n, q, 2)
        tones.append(Line(f"q = {q}", omega, response(n, q, 2, omega / ratio) * ratio))
    orders = np.arange(6)
    rules = {"equal mu": lambda n, q, i: 1.0, "equal bias": equal_bias, "equal bandwidth": equal_bandwidth}
    white = [
        Line(f"x{i}, {name}", orders, [relative_white(n, int(q), i, rule(n, int(q), i)) for q in orders], style)
        for (name, rule), style in zip(rules.items(), (":", "-", "--"), strict=True)
        for i in (1, 2, 3)
    ]
    return Picture(
        "001_noise",
        "Ours: n = 3. Integrators help against tones far above the bandwidth; what they are "
        "worth against white noise depends on what is held equal.",
        (
            Panel("Tones in xhat_2 at equal bias", "frequency / mu_0", "|Xhat_2 / Y|", tuple(tones), "log", "log"),
            Panel("White noise", "q", "rms error over that of q = 0", tuple(white)),
        ),
    )


def duffing() -> Picture:
    ts, mu = np.arange(0, 10, 5e-3), 12.0
    plant, lines, errors = Duffing(), [], []
    for name, phi in (("cubic", DuffingRoot(plant)), ("rational, corrected (41)", DuffingRational(plant))):
        observer = Algebraic(phi, make_tracker(3, 1, mu))
        run = simulate(
            plant, observer, x0=(1.0, 0.0), xhat0=(0.0, 0.5), ts=ts, noise=Gaussian(jnp.asarray(0.1)), key=jax.random.key(1)
        )
        if not lines:
            lines.append(Line("x1", ts, np.asarray(run.x[:, 0]), "--"))
        lines.append(Line(name, ts, np.asarray(run.xhat[:, 0])))
        errors.append(Line(name, ts, np.abs(np.asarray(run.xhat - run.x)[:, 0])))
    return Picture(
        "001_duffing",
        "Ours: the oscillator (40) from (1, 0), noise of standard deviation 0.1 held 5 ms, n = 3, q = 1, mu = 12, H(0) = I. "
        "Both maps are exact; the rational one has a singularity that noise reaches.",
        (
            Panel("x1 and its estimates", "t [s]", "x1", tuple(lines), ylim=(-2.0, 2.0)),
            Panel("Errors", "t [s]", "|xhat_1 - x1|", tuple(errors), yscale="log", ylim=(1e-4, 1e2)),
        ),
    )


PICTURES = (peaking, noise, duffing)
