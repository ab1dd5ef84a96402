"""A comparison: a set of published measurements, and what one of our models says about it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Finding:
    """What a comparison ends in: a table of numbers, lines by columns.

    samples: of all that is compared; held_out: those that are judged and were used for no fit. lines: name -> a number
    for each heading, None where there is none. unit: of the numbers. better, worse: names of two lines, of which the
    first is expected to be no larger than the second one, in the mean over the columns. fitted: what was fitted, in
    words with its numbers.
    """

    samples: int
    held_out: int
    unit: str
    headings: Sequence[str]
    lines: Mapping[str, Sequence[float | None]]
    better: str = ""
    worse: str = ""
    fitted: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the finding as JSON-ready values."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Comparison:
    """name: of it and of its folder in the folder of data. files: glob patterns in that folder, each needs a match.

    about: what is compared, and how. obtain: how to get the set, in one line; licence: the set's. compare: takes the
    set's folder.
    """

    name: str
    title: str
    files: Sequence[str]
    about: str
    obtain: str
    licence: str
    compare: Callable[[Path], Finding]

    def found(self, data: Path) -> list[Path]:
        """Return the files of the set in the folder of data, sorted; none where one of its patterns has no match."""
        matches = [sorted((data / self.name).glob(pattern)) for pattern in self.files]
        return [path for each in matches for path in each] if all(matches) else []
