"""The error dynamics with its gains, its noises and what counts of it, in coordinates and units of one's choice."""

import dataclasses

import numpy as np
import scipy.linalg

from jaxobs.designs.polytope import Polytope

ROUNDING = 1e-12  # relative: eigenvalues closer to the border than this may lie on it


@dataclasses.dataclass(frozen=True)
class Dynamics:
    """e' = F(rho) e + process w - (L + b diag(rho) K) noise v,   F(rho) = a + b diag(rho) (c - K output) - L output,

    of which weight e counts. model: (a, b, c, output, bounds); gain L (n, p); inner K (r, p); weight (s, n); process (n, m);
    noise (p, k); w and v of unit intensity (or energy).
    """

    model: Polytope
    gain: np.ndarray
    inner: np.ndarray
    weight: np.ndarray
    process: np.ndarray
    noise: np.ndarray

    @property
    def closed(self) -> np.ndarray:
        """a - L output."""
        return self.model.a - self.gain @ self.model.output

    @property
    def seen(self) -> np.ndarray:
        """c - K output (r, n): what the slopes multiply."""
        return self.model.c - self.inner @ self.model.output

    def at_corners(self) -> np.ndarray:
        """F(rho) at the corners, (corners, n, n)."""
        return self.closed + (self.model.b * self.model.parameters()[:, None, :]) @ self.seen

    def at_middle(self) -> np.ndarray:
        """F(rho) in the middle of the box, (n, n)."""
        return self.closed + (self.model.b * self.middle) @ self.seen

    def injections(self) -> np.ndarray:
        """The basis (.., r, p) of the K that f(xhat + K_x (y - C xhat)) can have: K = c K_x for some K_x (n, p)."""
        left, lengths, _ = np.linalg.svd(self.model.c, full_matrices=False)
        seen = left[:, lengths > 1e-12 * lengths.max(initial=0.0)]
        return np.einsum("ri,jp->ijrp", seen, np.eye(self.model.p)).reshape(-1, self.model.r, self.model.p)

    @property
    def middle(self) -> np.ndarray:
        """rho there, (r,)."""
        return (self.model.lower + self.model.upper) / 2

    @property
    def speed(self) -> float:
        """The size of the entries of F, a rate."""
        widest = np.maximum(np.abs(self.model.lower), np.abs(self.model.upper))
        parts = np.abs(self.closed) + (np.abs(self.model.b) * widest) @ np.abs(self.seen)
        return max(float(np.linalg.norm(parts, 2)), 1e-300)

    def with_gains(self, gain: np.ndarray, inner: np.ndarray | None = None) -> "Dynamics":
        """The same under another L, and another K if one is given."""
        return dataclasses.replace(self, gain=gain, inner=self.inner if inner is None else inner)

    def in_coordinates(self, t: np.ndarray) -> "Dynamics":
        """The same of t^-1 e. Powers of two first, which round nothing: the rows of t may span decades."""
        sizes = 2.0 ** np.round(np.log2(np.linalg.norm(t, axis=1)))
        here = self
        for part in (np.diag(sizes), t / sizes[:, None]):
            moved = {"gain": np.linalg.solve(part, here.gain), "process": np.linalg.solve(part, here.process)}
            here = dataclasses.replace(here, model=here.model.in_coordinates(part), weight=here.weight @ part, **moved)
        return here

    def in_time(self, unit: float) -> "Dynamics":
        """The same in the time t / unit; weight and noises are left as they are, so that L noise shrinks with L."""
        return dataclasses.replace(self, model=self.model.in_time(unit), gain=self.gain * unit)

    def scaled(self) -> tuple["Dynamics", float, np.ndarray]:
        """(the same in units of its own speed, the speed, the units s_k): b_k s_k and what rho_k can add to it, times (c_k -
        K_k output) / s_k, have one length."""
        speed = self.speed
        here = self.in_time(1 / speed)
        half = (here.model.upper - here.model.lower) / 2
        left, right = np.linalg.norm(here.model.b, axis=0), np.linalg.norm(here.seen, axis=1) * half
        known = (left > 0) & (right > 0)
        s = 2.0 ** np.round(np.log2(np.where(known, right, 1.0) / np.where(known, left, 1.0)) / 2)
        model = dataclasses.replace(here.model, b=here.model.b * s, c=here.model.c / s[:, None])
        return dataclasses.replace(here, model=model, inner=here.inner / s[:, None]), speed, s


def balancing(f: np.ndarray) -> np.ndarray:
    """The diagonal t, of powers of two, that makes rows and columns of t^-1 f t alike in size."""
    _, (scales, _) = scipy.linalg.matrix_balance(f, permute=False, separate=True)
    return np.diag(scales)


def stationary(f: np.ndarray, injected: np.ndarray, *, step: bool = False) -> np.ndarray | None:
    """X = E e e' in the steady state of e' = F e + G w, w white of unit intensity:  F X + X F' + G G' = 0

    (step: F X F' - X + G G' = 0). f (n, n), injected G (n, m); None where F is not stable, or not to rounding. In balanced
    coordinates, since the gains of a chain spread over many decades."""
    t = np.diagonal(balancing(f))
    inside, source = f / t[:, None] * t, injected / t[:, None]
    values, size = np.linalg.eigvals(inside), float(np.linalg.norm(inside, 2))
    if np.max(np.abs(values) - 1 if step else values.real) >= -ROUNDING * (1.0 if step else size):
        return None
    solve = scipy.linalg.solve_discrete_lyapunov if step else scipy.linalg.solve_continuous_lyapunov
    x = solve(inside, source @ source.T if step else -source @ source.T)
    return (x + x.T) / 2 * np.outer(t, t)


def centred(p: np.ndarray) -> np.ndarray:
    """t (n, n) with t'P t = I, for P > 0. LinAlgError for a P that is not."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(p), np.finfo(float).tiny))  # a first, diagonal, step: P may span decades
    unit = (p + p.T) / 2 * np.outer(scale, scale)
    return scale[:, None] * np.linalg.inv(np.linalg.cholesky(unit)).T
