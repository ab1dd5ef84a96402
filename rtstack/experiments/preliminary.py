"""Figures and claims of a campaign that is not finished, from the results that there are: now and then, as it runs."""

import sys
import time
from typing import Any

from rtstack.experiments.experiment import Experiment, Results
from rtstack.experiments.report import write_preliminary
from rtstack.experiments.store import Store

EVERY_S = 30.0
SHARE = 0.05  # of the runner's time at most


class Preliminary:
    """Called after each result that was kept; draws where the last drawing is some time ago."""

    def __init__(self, experiment: Experiment[Any, Any], store: Store) -> None:
        self._experiment = experiment
        self._store = store
        self._due_s = time.monotonic() + EVERY_S

    def __call__(self) -> None:
        began_s = time.monotonic()
        if began_s < self._due_s:
            return
        rows = self._store.rows(self._experiment.cases(self._store.rows()))
        try:
            report = self._experiment.report(Results(rows, self._store.out, preliminary=True))
            write_preliminary(report, self._experiment, self._store)
        except Exception as error:  # of a kind's report: the results matter more than a picture of them
            print(f"rtstack: no figures meanwhile: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            self._due_s = float("inf")
            return
        ended_s = time.monotonic()
        self._due_s = ended_s + max(EVERY_S, (ended_s - began_s) / SHARE)
