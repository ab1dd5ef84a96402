"""`python -m tests.programs.turned_bases [--demonstrations 20]`: how often good grabs are called unexpected, a table.

In the cell as its file says, and in one whose bases are 20 mm higher and turned by 4 and 3 degrees, with the true bases
in its file. Each demonstration has a number and a seed that no tuning was made with, and one trial with another seed;
then the same trials with an object of three times the mass: each of those has to be told.
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from tests.support.turned_cell import TURNED, BuiltCell

CASES: dict[str, dict[str, object]] = {"as the file says": {}, "bases 20 mm higher, turned by 4 and 3 deg": TURNED}
FIRST = 100  # the tunings are made of the demonstrations 21 to 28
HEAVIER = '[[fault]]\nkind = "object_mass"\nat_s = 0.0\nmass_factor = 3.0\n'


def row(name: str, built: dict[str, object], demonstrations: int, folder: Path) -> str:
    """Return a case's row."""
    cell, good, kinds, failed, smallest = BuiltCell.write(folder, built), Counter(), Counter(), 0, 1.0
    faults = folder / "faults.toml"
    faults.write_text(HEAVIER)
    for number in range(FIRST, FIRST + demonstrations):
        recording = folder / f"taught-{number}.mcap"
        taught = cell.teach(recording, number, number)
        result = cell.trial(recording, folder / f"good-{number}.mcap", 1000 + number)
        heavy = cell.trial(recording, folder / f"heavy-{number}.mcap", 2000 + number, faults=faults)
        failed += not (taught.success and result.success)
        good[result.impact_reason or result.impact_verdict] += 1
        smallest = min(smallest, result.impact_margin)
        kinds[heavy.impact_kind or heavy.impact_verdict] += 1
    counts = (", ".join(f"{key} {count}" for key, count in each.most_common()) for each in (good, kinds))
    return f"| {name} | {demonstrations - failed} | {' | '.join(counts)} | {smallest:.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--demonstrations", type=int, default=20)
    count = parser.parse_args().demonstrations
    print(f"| built | grabs that succeed, of {count} | verdicts | three times the mass | smallest margin |")
    print("|---|---|---|---|---|")
    for name, built in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            print(row(name, built, count, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
