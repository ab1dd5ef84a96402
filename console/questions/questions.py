"""Questions about logs that take seconds: answered by processes of their own, two at a time, and remembered."""

import json
import pickle
import subprocess
import threading
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from console.child_process import start, why_ended
from console.refused import Refused
from rtstack.model.cell_description import CellDescription

_AT_ONCE = 2
_REMEMBERED = 32


class Question(Future[dict[str, Any]]):
    """A question that was asked, and the last line of the process that answers it. share: how much is made, 0 to 1."""

    share = 0.0

    def answer(self) -> Any:
        """Wait for the answer. Raises Refused."""
        words = self.result()
        if "refused" in words:
            raise Refused(409, words["refused"])
        return words["answer"]

    def take(self, words: dict[str, Any]) -> None:
        """Take a line of the process that answers."""
        self.share = words.get("share", self.share)
        if words.keys() & {"answer", "refused"}:
            self.set_result(words)


class Questions:
    """Asks about logs of one cell. May be used from any thread; `close` ends what is being answered."""

    def __init__(self, cell: CellDescription) -> None:
        self._cell = cell
        self._lock = threading.Lock()
        self._asked: OrderedDict[tuple[Any, ...], tuple[Question, Future[None]]] = OrderedDict()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._closed = False
        self._threads = ThreadPoolExecutor(_AT_ONCE, "question")

    def ask(self, kind: str, path: Path, more: Any = None) -> Question:
        """Return a question about a log as it is now: asked now, or before. Raises OSError."""
        status = path.stat()
        key = kind, path, status.st_size, status.st_mtime_ns, more
        with self._lock:
            for other in [each for each in self._asked if each[:2] == key[:2] and each[2:4] != key[2:4]]:
                overtaken, begun = self._asked[other]
                if begun.cancel():
                    overtaken.take({"refused": f"{path} has changed meanwhile: ask again"})
                    del self._asked[other]
            asked = self._asked.pop(key, None)
            if asked is None:
                question = Question()
                words = pickle.dumps((kind, path, self._cell, more))
                asked = question, self._threads.submit(self._answer, question, words)
            self._asked[key] = asked
            while len(self._asked) > _REMEMBERED:
                self._asked.popitem(last=False)
        return asked[0]

    def close(self) -> None:
        """End the processes, and take no question any more."""
        with self._lock:
            self._closed = True
            for process in self._running:
                process.terminate()
        self._threads.shutdown(cancel_futures=True)

    def _answer(self, question: Question, asked: bytes) -> None:
        with self._lock:
            if self._closed:
                return
            process = start("console.questions.answering", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            self._running.add(process)
        assert process.stdin is not None
        assert process.stdout is not None
        with process:
            try:
                process.stdin.write(asked)
                process.stdin.close()
                for line in process.stdout:
                    question.take(json.loads(line))
            except (OSError, ValueError):
                pass  # it has ended: told below
        with self._lock:
            self._running.discard(process)
        if not question.done():
            question.take({"refused": f"looking at it: {why_ended(process.returncode)}"})
