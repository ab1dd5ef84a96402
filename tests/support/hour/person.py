"""A person at the terminal of the hour: begins each step, types its word, holds the space bar while an arm moves."""

import os
import re
import threading
import time
from collections.abc import Mapping

from tests.support.terminal import Terminal

_HOLD = "Hold the space bar. The arms move"
_REPEATED_S = 0.02
# what a prompt ends with, and what is typed; a held key leaves spaces behind
PROMPTS = (
    (r"Type the cell's name, (\S+), and Enter: *", r"\1"),
    (r'type "([\w-]+)" to begin; s: leave it out; q: end for now: *', r"\1"),
    (r"; q: end for now: *", ""),
    (r"mass of the weight[^\n]*: *", "500"),
    (r"Enter(?: recovers it|: go on)?: *", ""),
)


class Person(Terminal):
    """answers: by a word of the step's title line, what is typed in the place of what begins that step."""

    def attend(self, answers: Mapping[str, str] | None = None) -> None:
        """Answer and hold until the program has ended."""
        os.close(self.theirs)
        threading.Thread(target=self._listen, daemon=True).start()
        handled, holding = 0, False
        while not self._ended.is_set():
            time.sleep(_REPEATED_S)
            new = self.said[handled:]
            typed = self._typed(new, answers or {})
            if typed is not None:
                self._write(f"{typed}\n")
                handled, holding = handled + len(new), False
            elif _HOLD in new:
                handled, holding = handled + new.index(_HOLD) + len(_HOLD), True
            elif holding:
                self._write(" ")
        os.close(self._ours)

    @staticmethod
    def _typed(new: str, answers: Mapping[str, str]) -> str | None:
        for pattern, answer in PROMPTS:
            if (found := re.search(f"{pattern}$", new)) is not None:
                title = re.findall(r"^--- (.*?) \(", new, re.MULTILINE)
                for word, other in answers.items():
                    if title and word in title[-1]:
                        return other
                return found.expand(answer)
        return None
