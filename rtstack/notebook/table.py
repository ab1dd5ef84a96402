"""The table of several trials: rows, means with their intervals, and how a notebook shows them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from html import escape
from typing import Any

from hal.base.configuration import ConfigurationError
from rtstack.experiments.claims import shown
from rtstack.experiments.statistics import Interval, plain_mean, proportion
from rtstack.trials.errors import TrialError
from rtstack.trials.result import TrialResult

# column: heading
_MEANS = {"success": "success", "average_force_norm": "mean force norm", "peak_force_norm": "peak force norm",
          "max_lift_mm": "lift, mm"}  # fmt: skip


@dataclass(frozen=True, slots=True, repr=False)
class TrialTable(Sequence[TrialResult]):
    """The results of several trials, in the order of controllers, displacements and seeds.

    Args:
        rows: A result for each trial that was run.
        missing: In one line each, which trials could not be run, and why.
    """

    rows: tuple[TrialResult, ...]
    missing: tuple[str, ...] = ()
    columns = tuple(each.name for each in fields(TrialResult))

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        return self.rows[index]

    def column(self, name: str) -> list[Any]:
        """Return a column's values, one a row. Raises TrialError for a name that is no field of TrialResult."""
        if name not in self.columns:
            raise TrialError(f"unknown column {name!r}: choose one of {', '.join(self.columns)}")
        return [getattr(row, name) for row in self.rows]

    def mean(self, name: str) -> Interval | None:
        """Return the mean of a column of numbers with its 95 % interval, over the rows that have a value; None without
        one."""
        return plain_mean(float(value) for value in self.column(name) if value is not None)

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame with a line for each row. Raises ConfigurationError without pandas."""
        try:
            import pandas  # pyright: ignore[reportMissingImports]  # optional
        except ModuleNotFoundError:
            raise ConfigurationError("a table as a DataFrame needs pandas: pip install pandas") from None
        return pandas.DataFrame([asdict(row) for row in self.rows], columns=list(self.columns))

    def _lines(self) -> list[list[str]]:
        """Return the headings, and a line for each controller, object and displacement."""
        groups: dict[tuple[str, str, str], list[TrialResult]] = {}
        for row in self.rows:
            groups.setdefault((row.controller, row.object, f"{row.displacement_mm:+g} mm"), []).append(row)
        lines = [["controller", "object", "displacement", "n", *_MEANS.values()]]
        for key, rows in groups.items():
            held = shown(proportion(sum(row.success for row in rows), len(rows)), " %", 0, 100.0)
            means = (shown(TrialTable(tuple(rows)).mean(name)) for name in [*_MEANS][1:])
            lines.append([*key, str(len(rows)), held, *means])
        return lines

    def __repr__(self) -> str:
        widths = [max(map(len, column)) for column in zip(*self._lines(), strict=True)]
        text = ("  ".join(map(str.ljust, line, widths)).rstrip() for line in self._lines())
        return "\n".join([*text, *self.missing])

    def _repr_html_(self) -> str:
        lines = ("".join(f"<td>{escape(cell)}</td>" for cell in line) for line in self._lines())
        return f"<table><tr>{'</tr><tr>'.join(lines)}</tr></table>{escape('; '.join(self.missing))}"
