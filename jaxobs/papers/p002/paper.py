"""Paper 002 and what it prints: the table of section IV."""

import dataclasses

from jaxobs.papers.claims import Paper

PAPER = Paper("002", "A. Zemouche, Observer design for nonlinear systems by using high-gain and LPV/LMI-based technique (2017)")

N = 5  # states of the example of section IV
NOISE = 0.1  # standard deviation of the measurement noise there
X0, XHAT0 = (1.0,) * N, (5.0,) * N


@dataclasses.dataclass(frozen=True)
class Printed:
    """A row of table I as it stands there; j0 = 0 is the standard high gain, without sigma and number of LMIs."""

    j0: int
    k_f: int
    lmis: str
    sigma: str
    theta: str
    gain: tuple[float, ...]

    @property
    def name(self) -> str:
        return f"Table I ({self.j0}, {self.k_f})"


TABLE = (
    Printed(0, 1, "", "", "31.72", (5.66, 13.12, 16.49, 11.12, 3.42)),
    Printed(0, 10, "", "", "273.03", (12.07, 33.47, 45.54, 31.58, 9.92)),
    Printed(0, 100, "", "", "2594.20", (32.51, 97.87, 137.15, 96.01, 30.39)),
    Printed(1, 1, "2", "5.2", "5.25", (5.38, 12.32, 15.54, 10.71, 3.51)),
    Printed(1, 10, "2", "17.5", "17.63", (5.46, 12.77, 16.61, 12.10, 4.51)),
    Printed(1, 100, "2", "62", "62", (11.43, 34.53, 53.42, 46.94, 24.56)),
    Printed(2, 1, "4", "2.5", "2.88", (5.11, 11.57, 14.74, 10.65, 4.08)),
    Printed(2, 10, "4", "7", "7.06", (5.34, 12.86, 17.89, 15.08, 7.92)),
    Printed(2, 100, "4", "23", "24.32", (6.22, 18.01, 32.19, 40.23, 39.86)),
    Printed(3, 1, "8", "2", "2.06", (4.73, 10.34, 13.03, 9.67, 4.19)),
    Printed(3, 10, "8", "4.4", "4.47", (5.22, 12.83, 19.04, 18.62, 13.31)),
    Printed(3, 100, "8", "14", "15.12", (6.92, 23.02, 50.57, 86.80, 133.18)),
)
