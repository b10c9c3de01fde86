"""Whether what the measurement adds is noise, or something that the observer should have known."""

from typing import Any, NamedTuple

import numpy as np
import scipy.stats
from jaxtyping import Float
from matplotlib.figure import Figure

from jaxobs._module import Numbers, refuse, require_integer
from jaxobs.plotting._covariance import believed
from jaxobs.plotting._runs import as_runs, chosen
from jaxobs.plotting.style import BLUE, GREY, INK, NOTE, ORANGE, SIGMAS, SKY, WHITE_BOX, headline, panels, root

SHARE = 0.95  # of the bands for correlation and chi squared


class Innovation(NamedTuple):
    """One output's valid innovations from `after` on: ts (N,), values (N,), deviations (N,) as believed, or as found.

    correlation (lags + 1,): r_0 = 1, r_1, ... about the mean, over pairs of valid samples; white: the half width
    1.96/sqrt(N) of what white noise stays within. p_value: of Ljung and Box over the lags. believed: whether the deviations
    are the observer's.
    """

    ts: Float[np.ndarray, " N"]
    values: Float[np.ndarray, " N"]
    deviations: Float[np.ndarray, " N"]
    correlation: Float[np.ndarray, " L"]
    white: float
    p_value: float
    believed: bool


def innovation(
    run: Any,
    *,
    output: int = 1,
    after: float = 0.0,
    lags: int = 40,
    variance: Numbers | None = None,
    observer: Any = None,
    title: str = "",
    figure: Any = None,
) -> Figure:
    """Innovation r_k = y_k - expected y_k of one output, in four panels: the sequence with +-2 sigma; its autocorrelation with
    the band of white noise; its histogram beside the normal density; r_k^2 / sigma_k^2 with its mean over a sliding window.

    An observer that has used all there is in y leaves white innovations; whiteness says nothing of x itself. sigma_k^2 is
    `variance`, a number or (T,), what the design believes; or that of a Kalman `observer` along the run, C P_k^- C' + r; or
    else the mean square that is found, whose ratio is 1 by construction. Windows of W samples of white noise of that
    variance have means within the chi^2_W quantiles / W of 95 % (dashed). run: a Trajectory, an Estimate or Derivatives,
    one run. after [s]: where the transient is over. output: from 1. ValueError for fewer than `lags` + 10 valid samples,
    and anything else that does not fit. Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking
    and Navigation, section 5.4; Ljung and Box, Biometrika 65 (1978) 297-303.
    """
    found = statistics("innovation", run, output, after, lags, variance, observer)
    with panels("innovation", figure, (9.4, 5.8), 2, 2) as (whole, axes):
        _sequence(axes[0, 0], found)
        _correlation(axes[0, 1], found)
        _histogram(axes[1, 0], found)
        _squares(axes[1, 1], found)
        headline(whole, title)
        return root(whole)


def statistics(owner: str, run: Any, output: int, after: float, lags: int, variance: Any, observer: Any) -> Innovation:
    """What the panels show."""
    runs, where = as_runs(owner, run), f"plotting.{owner}"
    require_integer(where, "lags", lags, 1, "It counts the lags of the autocorrelation.")
    if runs.innovation is None or runs.count != 1:
        given = f"{runs.count} runs" if runs.count != 1 else "a run without innovations"
        raise refuse(
            where, "run", given, "one Trajectory or Estimate", "Of a batch draw one: jax.tree.map(lambda a: a[0], runs)."
        )
    j = chosen(owner, "output", [output], runs.innovation.shape[2])[0]
    if variance is not None and observer is not None:
        raise refuse(where, "variance", "beside observer", "one of the two", "Both say what the innovation's variance is.")
    if observer is not None:
        expected = believed(owner, observer, run).innovation[:, j, j]
    elif variance is not None:
        given = np.asarray(variance, float)
        if given.shape not in ((), runs.ts.shape) or not np.all(given > 0):
            fix = "It is sigma^2 of the innovation, in units of y squared."
            raise refuse(where, "variance", f"shape {given.shape}", f"a number or {runs.ts.shape}, > 0", fix)
        expected = np.broadcast_to(given, runs.ts.shape)
    else:
        expected = None
    valid = np.ones(len(runs.ts), bool) if runs.valid is None else runs.valid[0, :, j]
    counts = valid & (runs.ts >= after) & np.isfinite(runs.innovation[0, :, j])
    if np.count_nonzero(counts) < lags + 10:
        fix = "Lower lags=, or after=."
        raise refuse(where, "run", f"{np.count_nonzero(counts)} valid samples from {after} s on", f"{lags + 10} or more", fix)
    path = np.where(counts, runs.innovation[0, :, j], np.nan)[int(np.argmax(counts)) :]
    values = path[np.isfinite(path)]
    correlation = autocorrelation(path, lags)
    size = len(values)
    box = size * (size + 2) * np.sum(correlation[1:] ** 2 / (size - np.arange(1, lags + 1)))
    deviations = np.sqrt(np.full(size, np.mean(values**2)) if expected is None else expected[counts])
    p_value = float(scipy.stats.chi2.sf(box, lags))
    return Innovation(runs.ts[counts], values, deviations, correlation, 1.96 / np.sqrt(size), p_value, expected is not None)


def autocorrelation(path: Float[np.ndarray, " T"], lags: int) -> Float[np.ndarray, " L"]:
    """sum_k r_k r_{k+l} / sum_k r_k^2 for l = 0..lags, of r less its mean; a lost sample (NaN) counts as the mean."""
    centred = np.nan_to_num(path - np.nanmean(path))
    total = float(centred @ centred)
    return np.array([float(centred[: len(centred) - k] @ centred[k:]) / total if total > 0 else 0.0 for k in range(lags + 1)])


def _sequence(ax: Any, found: Innovation) -> None:
    band = SIGMAS * found.deviations
    share = float(np.mean(np.abs(found.values) <= band))
    ax.fill_between(found.ts, -band, band, color=SKY, alpha=0.3, lw=0)
    reach = max(1.25 * float(np.quantile(np.abs(found.values), 0.995)), 2.2 * SIGMAS * float(np.median(found.deviations)))
    out = np.abs(found.values) > reach
    ax.plot(found.ts[~out], found.values[~out], ".", color=BLUE, ms=2.5)
    for sign, marker in ((1, "^"), (-1, "v")):  # beyond the axes, at their edge
        beyond = out & (sign * found.values > 0)
        ax.plot(found.ts[beyond], np.full(np.count_nonzero(beyond), sign * 0.95 * reach), marker, color=ORANGE, ms=5)
    ax.set_ylim(-reach, reach)
    ax.axhline(0, color=GREY, lw=0.8)
    kind = "as believed" if found.believed else "as found"
    ax.set(title=f"Innovation: {share:.1%} within ±{SIGMAS} sigma, {kind}", xlabel="time [s]", ylabel="innovation")
    ax.margins(x=0.01)


def _correlation(ax: Any, found: Innovation) -> None:
    lags = np.arange(1, len(found.correlation))
    own = found.correlation[1:]
    ax.axhspan(-found.white, found.white, color=SKY, alpha=0.3, lw=0)
    out = np.abs(own) > found.white
    for chosen_, colour, marker in ((~out, BLUE, "o"), (out, ORANGE, "D")):
        ax.vlines(lags[chosen_], 0, own[chosen_], color=colour, lw=1.3)
        ax.plot(lags[chosen_], own[chosen_], marker, color=colour, ms=3.5)
    ax.axhline(0, color=GREY, lw=0.8)
    reach = max(0.25, 1.15 * float(np.max(np.abs(own))))
    p = f"p = {found.p_value:.2g}" if found.p_value >= 1e-4 else "p < 0.0001"
    ax.set(ylim=(-reach, reach), xlabel="lag [samples]", ylabel="autocorrelation")
    ax.set_title(f"{np.count_nonzero(out)} of {len(own)} lags outside; Ljung–Box {p}")


def _histogram(ax: Any, found: Innovation) -> None:
    scaled = found.values / found.deviations
    reach = max(4.0, min(8.0, float(np.max(np.abs(scaled)))))
    ax.hist(np.clip(scaled, -reach, reach), bins=41, range=(-reach, reach), density=True, color=SKY, alpha=0.6, lw=0,
            label="innovation / sigma")  # fmt: skip
    grid = np.linspace(-reach, reach, 201)
    ax.plot(grid, scipy.stats.norm.pdf(grid), color=INK, lw=1.4, ls=(0, (5, 1.6)), label="normal")
    ax.set(xlabel="innovation / sigma", ylabel="density")
    ax.set_title(
        f"Skewness {scipy.stats.skew(scaled):.2f}, kurtosis {scipy.stats.kurtosis(scaled, fisher=False):.2f} (normal: 3)"
    )
    ax.set_ylim(top=1.22 * ax.get_ylim()[1])
    ax.legend(fontsize=NOTE, ncols=2, loc="upper left")


def _squares(ax: Any, found: Innovation) -> None:
    squares = (found.values / found.deviations) ** 2
    window = max(10, len(squares) // 20)
    mean = np.convolve(squares, np.full(window, 1 / window), mode="valid")
    middle = found.ts[window // 2 : window // 2 + len(mean)]
    low, high = scipy.stats.chi2.ppf([(1 - SHARE) / 2, (1 + SHARE) / 2], window) / window
    ax.plot(found.ts, squares, ".", color=GREY, ms=2, alpha=0.6)
    ax.plot(middle, mean, color=BLUE, label=f"mean of {window}")
    for level in (low, high):
        ax.axhline(level, color=INK, lw=1, ls=(0, (5, 1.6)), label=f"{SHARE:.0%} of white noise" if level == high else None)
    ax.set(yscale="log", ylim=(max(1e-3, np.min(squares[squares > 0], initial=1e-3)), 3 * max(10, np.max(squares))))
    ax.set(xlabel="time [s]", ylabel="innovation² / sigma²", title=_mean(found, squares))
    ax.legend(fontsize=NOTE, ncols=2, loc="upper right", **WHITE_BOX)
    ax.margins(x=0.01)


def _mean(found: Innovation, squares: np.ndarray) -> str:
    return f"Mean {np.mean(squares):.3g} (1 expected)" if found.believed else "Mean 1, since sigma is as found"
