"""Runs a page: its blocks in order, in one folder, as a reader would.

Plain commands of ours are asked in this process, which saves each the start of an interpreter; the README's, and
whatever needs a shell, are run by one.
"""

import contextlib
import doctest
import io
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from tests.support.docs.blocks import ROOT, Block, Use

BIN = Path(sys.executable).parent
PATIENCE_S = 200.0  # for a block in CI; those that take minutes have no limit
REPOSITORY = ("deploy", "examples", "sim_robot", "tests")  # what a reader has in the clone
_COMPARED = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
_CLONE = shutil.ignore_patterns(*REPOSITORY)
_PLAIN = re.compile(r"rtstack [\w ./:,=+-]+")  # nothing that a shell would change
_AS_READ = ROOT / "README.md"
_FOLDERS: dict[tuple[str, ...], Path] = {}  # what runs of the same commands in an empty folder have left behind


class Page:
    """A page that is being read, in an empty folder. `close` ends what runs until then.

    command_line: what runs a command of ours in this process.
    """

    def __init__(
        self,
        folder: Path,
        changed_to: Callable[[Path], Any],
        command_line: Callable[..., subprocess.CompletedProcess[str]],
    ) -> None:
        self._folder = folder
        self._command_line = command_line
        self._names: dict[str, Any] = {"__name__": "__main__"}
        self._running: list[tuple[Block, subprocess.Popen[str]]] = []
        self._history: tuple[str, ...] | None = ()
        for name in REPOSITORY:
            (folder / name).symlink_to(ROOT / name)
        changed_to(folder)

    def read(self, block: Block) -> None:
        """Do what a block says. Fails where it does not work."""
        if block.use is Use.FILE:
            (self._folder / block.title).write_text(block.text)
            self._history = None
        elif block.use is Use.BACKGROUND:
            self._start(block)
        elif block.language == "python":
            self._history = None
            self._execute(block)
        elif block.language == "console":
            self._converse(block)
        else:
            self._remembered(block)

    def close(self) -> None:
        """End what runs in terminals of its own, as Ctrl-C does, and look how it ends."""
        for block, process in reversed(self._running):
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=PATIENCE_S)
            assert process.returncode == 0, (block.place, errors)

    def abandon(self) -> None:
        """End what still runs, after something else has failed."""
        for _, process in self._running:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            process.communicate()

    def _execute(self, block: Block) -> None:
        """Run Python, and compare what it prints with the lines after # >, where it has some."""
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("\n" * block.line + block.text, block.place, "exec"), self._names)
        expected = "".join(f"{line}\n" for line in re.findall(r"^# > (.*)$", block.text, re.MULTILINE))
        said = not expected or doctest.OutputChecker().check_output(expected, printed.getvalue(), _COMPARED)
        assert said, f"{block.place}: expected:\n{expected}\nprinted:\n{printed.getvalue()}"

    def _run(self, block: Block, script: str) -> subprocess.CompletedProcess[str]:
        lines = script.strip().splitlines()
        if block.use is Use.RUN and block.page != _AS_READ and all(map(_PLAIN.fullmatch, lines)):
            return self._run_here(lines)
        patience_s = None if block.use is Use.SLOW else PATIENCE_S
        command = ["bash", "-euo", "pipefail", "-c", script]
        return subprocess.run(
            command, cwd=self._folder, env=environment(), text=True, timeout=patience_s,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def _run_here(self, lines: list[str]) -> subprocess.CompletedProcess[str]:
        status, said = 0, ""
        for line in lines:
            done = self._command_line(*shlex.split(line)[1:])
            status, said = done.returncode, said + done.stdout + done.stderr
            if status:
                break
        return subprocess.CompletedProcess(lines, status, said)

    def _remembered(self, block: Block) -> None:
        """Run commands, or take what the same ones have left behind on a page before: recordings are expensive."""
        history = None if self._history is None else (*self._history, block.text)
        if history in _FOLDERS:
            shutil.copytree(_FOLDERS[history], self._folder, ignore=_CLONE, dirs_exist_ok=True)
        else:
            done = self._run(block, block.text)
            assert done.returncode == 0, f"{block.place}: status {done.returncode}\n{done.stdout}"
        self._history = history
        if history is not None and history not in _FOLDERS:
            _FOLDERS[history] = self._folder.with_name(f"{self._folder.name}-{len(history)}")
            shutil.copytree(self._folder, _FOLDERS[history], ignore=_CLONE)

    def _converse(self, block: Block) -> None:
        """Run each command after a `$`, and compare what it says; a line of ours that refuses means status 1 or 2."""
        for command, expected in conversation(block.text):
            done = self._run(block, command)
            said = doctest.OutputChecker().check_output(expected, done.stdout, _COMPARED)
            assert said, f"{block.place}: {command}\nexpected:\n{expected}\nsaid:\n{done.stdout}"
            refused = expected.startswith("rtstack: ")
            assert (done.returncode in (1, 2)) if refused else done.returncode == 0, (block.place, done.returncode)
        self._history = None

    def _start(self, block: Block) -> None:
        command = ["bash", "-c", f"exec {block.text}"]
        process = subprocess.Popen(
            command, cwd=self._folder, env=environment(), text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self._running.append((block, process))
        assert process.stdout is not None
        assert process.stdout.readline().strip(), block.place


def environment() -> dict[str, str]:
    """Return the environment of somebody who has activated the virtual environment of this clone."""
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    return {**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}", "PYTHONPATH": paths}


def conversation(text: str) -> Iterable[tuple[str, str]]:
    """Yield each command with what is shown of its answer."""
    for part in ("\n" + text).split("\n$ ")[1:]:
        command, _, answer = part.partition("\n")
        yield command, answer if answer.endswith("\n") or not answer else answer + "\n"
