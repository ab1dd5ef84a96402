"""Record the runs anew on which every change of the law is replayed (tests/playback/test_replay.py).

Run it when the law is changed on purpose, and put the lines that it prints, what differed, into the commit's message.

Takes a minute.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rtstack.cells import load_description, open_cell
from rtstack.trials.record import RunSamples
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from tests.programs import program
from tests.support.recorded_run import FOLDER, KINDS, REFERENCE, kept_reference, replayed, saved
from tests.support.runs import demonstrate


class _StopAt:
    """A stop after so many ticks, which it counts as a watchdog."""

    def __init__(self, ticks: int) -> None:
        self._left = ticks

    def trip(self) -> None:
        self._left -= 1

    @property
    def stop_requested(self) -> bool:
        return self._left < 0


def main(out: Path = FOLDER) -> None:
    description, _ = load_description(None)
    out.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        reference = Path(folder) / "ref.mcap"
        demonstrate(reference, description)
        if not (kept := out / REFERENCE.name).exists():
            prepared = prepare_trial(TrialSpecification(str(reference)), description)
            longest = max(kind.ticks for kind in KINDS)
            np.savez_compressed(kept, **kept_reference(prepared.reference, longest))
        for kind in KINDS:
            file = out / f"{kind.name}.npz"
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
    program(main)
