"""Which inclinations a tuning expects always, sometimes and never: Figures 7 and 8 in numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from rtstack.experiments.experiment import Row


@dataclass(frozen=True, slots=True)
class Bands:
    """shares: inclination, degrees, ascending -> share of its cases that were expected; fewest: cases of an
    inclination."""

    shares: dict[float, float]
    cases: int
    fewest: int = 2

    @property
    def certain(self) -> list[float]:
        """The inclinations that are always expected, wherever they lie."""
        return [deg for deg, share in self.shares.items() if share == 1.0]

    @property
    def always(self) -> tuple[float, float] | None:
        """The band about 0 that is always expected, from and to, degrees; None where 0 is not."""
        edges = [self._outwards(sign) for sign in (-1.0, 1.0)]
        return (edges[0], edges[1]) if self.shares.get(0.0) == 1.0 else None

    @property
    def sometimes(self) -> list[float]:
        return [deg for deg, share in self.shares.items() if 0.0 < share < 1.0]

    @property
    def never(self) -> tuple[float | None, float | None]:
        """From which inclination on, outwards, all are unexpected: below 0 and above it; None where none is."""
        known = list(self.shares)
        below = [deg for deg in known if deg <= 0.0 and all(self.shares[d] == 0.0 for d in known if d <= deg)]
        above = [deg for deg in known if deg >= 0.0 and all(self.shares[d] == 0.0 for d in known if d >= deg)]
        return max(below, default=None), min(above, default=None)

    @property
    def ambiguity_deg(self) -> tuple[float, float]:
        """From the last inclination that is always expected to the first that never is, on either side, degrees."""
        always = self.always or (0.0, 0.0)
        below, above = self.never
        return (inf if below is None else always[0] - below, inf if above is None else above - always[1])

    def words(self) -> str:
        if self.always is None:
            others = ", ".join(f"{deg:+g}" for deg in self.certain)
            return f"not 0 deg ({100.0 * self.shares.get(0.0, 0.0):.0f} %)" + f", but {others} deg" * bool(others)
        low, high = self.always
        return "0 deg" if low == high == 0.0 else f"{low:+g} .. {high:+g} deg"

    def _outwards(self, sign: float) -> float:
        edge = 0.0
        for deg in sorted((deg for deg in self.shares if sign * deg > 0.0), key=abs):
            if self.shares[deg] < 1.0:
                break
            edge = deg
        return edge


def bands(rows: Sequence[Row], monitor: str) -> Bands:
    """Return the bands of a tuning over these rows."""
    counts: dict[float, list[int]] = {}
    for row in rows:
        expected = row[f"verdict_{monitor}"] == "expected"
        counts.setdefault(row["inclination_deg"], []).append(int(expected))
    shares = {deg: sum(values) / len(values) for deg, values in sorted(counts.items())}
    return Bands(shares, len(rows), min(map(len, counts.values()), default=0))
