"""The fields that claims about error dynamics share: the model with its box, the gain, the block of bounded norm."""

import dataclasses

from jaxobs.certificates.base import AbstractCertificate, FloatMatrix


@dataclasses.dataclass(frozen=True)
class AbstractModel(AbstractCertificate):
    """A(rho) = a + sum_k rho_k b_k c_k',   lower <= rho <= upper,   of which the outputs see `output`.

    a (n, n), b (n, r) with columns b_k, c (r, n), lower and upper (r,), output (p, n). tied (r,): channels with equal numbers
    have one parameter; () if none are.
    """

    a: FloatMatrix
    b: FloatMatrix
    c: FloatMatrix
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    output: FloatMatrix
    _: dataclasses.KW_ONLY
    tied: tuple[int, ...] = ()


@dataclasses.dataclass(frozen=True)
class AbstractError(AbstractModel):
    """F(rho) = a + sum_k rho_k b_k (c_k - inner_k output) - gain output.

    gain L (n, p); inner (r, p), the injection into f, or (); origin: where the bounds come from, a sentence.
    """

    gain: FloatMatrix
    _: dataclasses.KW_ONLY
    inner: FloatMatrix = ()
    origin: str = "given"


@dataclasses.dataclass(frozen=True)
class AbstractUncertainError(AbstractError):
    """F(rho) + left Delta right, |Delta(t)| <= 1, and the multipliers that prove something of it.

    left (n, u), right (v, n), tau, or () and 0; taus (r,): of the channels, 0 for corners, or ().
    """

    _: dataclasses.KW_ONLY
    left: FloatMatrix = ()
    right: FloatMatrix = ()
    tau: float = 0.0
    taus: tuple[float, ...] = ()
