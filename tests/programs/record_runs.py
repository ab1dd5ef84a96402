"""Record the runs anew on which every change of the law is replayed (tests/playback/test_recorded_runs.py).

    python -m tests.programs.record_runs

Run it when the law is changed on purpose, and put the lines that it prints, what differed, into the commit's message.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rtstack.cells import default_cell_file, load_description, open_cell
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import RunSamples, open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification
from tests.support.recorded_run import FOLDER, KINDS, replayed, saved


class _StopAt:
    """A stop after so many ticks, which it counts as a watchdog."""

    def __init__(self, ticks: int) -> None:
        self._left = ticks

    def trip(self) -> None:
        self._left -= 1

    @property
    def stop_requested(self) -> bool:
        return self._left < 0


def main() -> None:
    description, _ = load_description(None)
    FOLDER.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        reference = Path(folder) / "ref.mcap"
        asked = DemonstrationSpecification()
        cell = open_cell("direct", asked.object, 0.0, asked.seed)
        log = open_log(reference, asked, description, "direct", default_cell_file())
        run_demonstration(asked, description, cell, RunContext(log))
        cell.close()
        for kind in KINDS:
            file = FOLDER / f"{kind.name}.npz"
            if file.exists():
                print(f"{kind.name}: {replayed(kind, file, reference, description) or 'the same'}")
            script = Path(folder) / "faults.toml"
            script.write_text(kind.faults, encoding="utf-8")
            cell = open_cell("direct", "rice_box", kind.shift_m, 4, faults=script if kind.faults else None)
            samples = RunSamples(file)
            stop = _StopAt(kind.stop) if kind.stop is not None else None
            context = RunContext(samples, stop=stop, watchdogs=() if stop is None else (stop,))
            kind.start(reference, description)(cell, context)
            cell.close()
            assert samples.columns is not None
            np.savez_compressed(file, **saved(samples.columns, kind.ticks))
            print(
                f"{kind.name}: {min(kind.ticks, samples.columns.arm.shape[1])} ticks, {file.stat().st_size // 1000} kB"
            )


if __name__ == "__main__":
    main()
