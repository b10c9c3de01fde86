"""What `jaxobs.tune` returns."""

import dataclasses
from typing import Any

from jaxobs.certificates import AbstractCertificate
from jaxobs.observers import Observer
from jaxobs.tuning.history import History


def change(new: float, old: float) -> str:
    """The relative change of a positive loss; the difference of one that may be negative, as a likelihood is."""
    return f"{new / old - 1:+.1%}" if new > 0 and old > 0 else f"{new - old:+.4g}"


@dataclasses.dataclass(frozen=True, eq=False)
class Tuned:
    """observer, with the parameters theta, and the certificate of its `rate` (None if none was asked for), verified.

    loss: the mean over the keys; first_loss: at theta0; free_loss: what the same search reached without a certificate, None if
    it was not asked for. start: the number of the start it came from (0 is theta0). repaired: the starts that did not prove the
    rate and were moved until they did. dropped: those that could not be, with the rate that they reached. stopped: by Ctrl-C.
    """

    observer: Observer
    certificate: AbstractCertificate | None
    history: History
    theta: Any
    loss: float
    first_loss: float
    free_loss: float | None
    rate: float
    unit: str
    start: int
    repaired: tuple[int, ...] = ()
    dropped: tuple[tuple[int, float], ...] = ()
    stopped: bool = False

    def __str__(self) -> str:
        lines = [f"loss {self.loss:.6g}, {change(self.loss, self.first_loss)} against {self.first_loss:.6g} at theta0"]
        if self.certificate is None:
            lines.append("nothing is proved: certify=None")
        else:
            what = "factor" if self.unit == "a step" else "decay rate"
            lines.append(f"proved in exact arithmetic: {what} {self.rate:.6g} {self.unit} ({self.certificate.theorem})")
        if self.free_loss is not None:
            price = change(self.loss, self.free_loss)
            lines.append(f"without the proof the same search reaches {self.free_loss:.6g}: the proof costs {price}")
        h = self.history
        lines.append(f"{h.loss.shape[1]} steps from {h.loss.shape[0]} starts, {h.calls} calls, {h.seconds:.1f} s"
                     f" ({h.compile_seconds:.1f} s to compile); best start {self.start}")  # fmt: skip
        lines += [f"start {i} did not prove the rate and was repaired" for i in self.repaired]
        lines += [f"start {i} was dropped: it proves no more than {rate:.6g} {self.unit}" for i, rate in self.dropped]
        lines += h.refused()
        return "\n".join(lines + (["stopped before the end"] if self.stopped else []))
