"""One quadratic Lyapunov function for a box of parameters and a block of bounded norm: continuous time, and discrete time."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractUncertainError
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class Corners(AbstractUncertainError):
    """For e' = (F(rho) + left Delta right) e with F(rho) = a + sum_k rho_k b_k (c_k - inner_k output) - gain output,

        P > 0   and   F'P + P F + 2 rate P < 0   at all corners of lower <= rho <= upper

    imply |e(t)| <= sqrt(cond P) e^{-rate t} |e(0)| for every such rho(t), since the inequality is affine in rho. A block
    |Delta(t)| <= 1 joins by the S-procedure, [-(F'P + P F) - 2 rate P - tau right'right,  -P left;  *,  tau I] > 0, a channel
    with tau_k > 0 by (w - lower_k v)(upper_k v - w) >= 0 for w = rho_k v, v = (c_k - inner_k output) e, in place of corners.

    a (n, n), b (n, r) with columns b_k, c (r, n), lower and upper (r,), output (p, n), gain L (n, p), p (n, n), rate >= 0
    [1/s]; left (n, u), right (v, n), tau, or () and 0; taus (r,), 0 for corners, or (); inner (r, p), the injection into f,
    or (). origin: where the bounds come from, a sentence. tied (r,): channels with equal numbers have one parameter; () if
    none are. Source: paper 004, theorems 4.1 and 5.1; 003, lemma 1; 002, (31) at j0 = n; for blocks and multipliers Boyd et
    al., Linear Matrix Inequalities in System and Control Theory, 1994, sections 5.1 and 8.1; for inner Arcak and Kokotovic,
    Automatica 37 (2001) 1923-1930.
    """

    p: FloatMatrix
    rate: float
    theorem: ClassVar[str] = "corners"


@dataclasses.dataclass(frozen=True)
class StepCorners(AbstractUncertainError):
    """For e+ = (F(rho) + left Delta right) e with F(rho) as in Corners and lower <= rho_k <= upper,

        P > 0   and   F'P F < factor^2 P   at all corners

    imply |e_k| <= sqrt(cond P) factor^k |e_0| for every sequence rho, since F'P F is convex in rho. A block and channels with
    tau_k > 0 join as in Corners: [factor^2 P - tau right'right,  0,  F'P;  *,  tau I,  left'P;  *,  *,  P] > 0.

    Shapes as in Corners; factor in ]0, 1]. Source: paper 004, theorem 5.2 with (16); with a block paper 000, (51)-(63) and
    theorem 2.
    """

    p: FloatMatrix
    factor: float
    theorem: ClassVar[str] = "step-corners"
