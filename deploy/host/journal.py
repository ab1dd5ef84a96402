"""What was there before: written, and on the disk, before each change, so that any interruption can be taken back.

One JSON object a line. Undoing reads it from its end and drops each line once it is undone: it too may be interrupted.
"""

import base64
import contextlib
import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from deploy.host.changes import Change, Command, File, Knob
from deploy.host.machine import HostSetupError, Machine
from hal.base.files import PARTIAL, replacing

FILE = "/var/lib/rtstack-host-setup/journal"


class Journal:
    """The journal of a machine, in a file of it."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._path = machine.at(FILE)

    @property
    def entries(self) -> list[dict[str, Any]]:
        """Everything that was written and not taken back, oldest first. Raises HostSetupError."""
        try:
            lines = self._path.read_text().splitlines(keepends=True)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise HostSetupError(f"{self._path}: {error.strerror}; run it as root") from None
        try:
            # a line without its end was being written when the power went: its change has not begun
            return [json.loads(line) for line in lines if line.endswith("\n")]
        except ValueError:
            raise HostSetupError(
                f"{self._path}: not a journal of ours; what it undoes has to be undone by hand"
            ) from None

    def apply(self, changes: tuple[Change, ...]) -> Iterator[Change]:
        """Apply the changes, one by one; each is yielded once it is done. Raises HostSetupError."""
        if not changes:
            return
        with _explained():
            if not self._path.parent.exists():
                made = _missing(self._path.parent)
                self._path.parent.mkdir(parents=True)
                self._note({"kind": "folders", "folders": [str(p.relative_to(self._machine.root)) for p in made]})
            for change in changes:
                match change:
                    case File():
                        self._write(change)
                    case Knob():
                        path = self._machine.at(change.path)
                        self._note({"kind": "knob", "path": change.path, "former": path.read_text().strip()})
                        path.write_text(change.value + "\n")
                    case Command():
                        if self._machine.run is None:
                            continue
                        self._note({"kind": "command", "undo": change.undo})
                        if change.do:
                            self._machine.run(change.do)
                yield change

    def undo(self, force: bool = False) -> Iterator[str]:
        """Put back what was there, newest first; yield a line each. force: changed files too. Raises HostSetupError."""
        entries = self.entries
        newest = {entry["path"]: entry for entry in entries if entry["kind"] == "file" and not force}
        for path, entry in newest.items():
            with contextlib.suppress(FileNotFoundError):
                now = self._machine.at(path).read_bytes()
                former = None if entry["former"] is None else base64.b64decode(entry["former"])
                if now != former and _digest(now) != entry["ours"]:
                    raise HostSetupError(f"{path} was changed since: keep a copy, then undo with --force")
        with _explained():
            while entries:
                entry = entries.pop()
                line = self._undone(entry)
                _replace(self._path, "".join(json.dumps(entry) + "\n" for entry in entries).encode(), 0o600)
                if entry["kind"] == "folders":
                    self._path.unlink()
                    _remove([self._machine.root / name for name in entry["folders"]])
                yield line

    def _write(self, change: File) -> None:
        path = self._machine.at(change.path)
        entry: dict[str, Any] = {"kind": "file", "path": change.path, "former": None, "ours": _digest(change.content)}
        with contextlib.suppress(FileNotFoundError):
            status = path.stat()
            former = base64.b64encode(path.read_bytes()).decode()
            entry |= {"former": former, "mode": status.st_mode & 0o7777, "owner": [status.st_uid, status.st_gid]}
        entry["folders"] = [str(folder.relative_to(self._machine.root)) for folder in _missing(path.parent)]
        self._note(entry)
        path.parent.mkdir(parents=True, exist_ok=True)
        _replace(path, change.content.encode(), change.mode)

    def _undone(self, entry: dict[str, Any]) -> str:
        match entry["kind"]:
            case "file":
                path = self._machine.at(entry["path"])
                _sweep(path)
                if entry["former"] is None:
                    path.unlink(missing_ok=True)
                else:
                    _replace(path, base64.b64decode(entry["former"]), entry["mode"], tuple(entry["owner"]))
                _remove([self._machine.root / name for name in entry["folders"]])
                return f"{entry['path']}: {'removed' if entry['former'] is None else 'as it was'}"
            case "knob":
                with contextlib.suppress(FileNotFoundError):  # it may have another number since a restart
                    self._machine.at(entry["path"]).write_text(entry["former"] + "\n")
                return f"{entry['path']}: {entry['former']}"
            case "command" if entry["undo"] and self._machine.run is not None:
                try:
                    self._machine.run(tuple(entry["undo"]))
                except HostSetupError as error:  # what it takes back may never have been done
                    return str(error)
                return "$ " + " ".join(entry["undo"])
        return ""

    def _note(self, entry: dict[str, Any]) -> None:
        with self._path.open("ab") as file:
            written = self._path.read_bytes()
            file.truncate(written.rfind(b"\n") + 1)  # without an incomplete last line
            file.write(json.dumps(entry).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())


def _digest(content: str | bytes) -> str:
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def _missing(folder: Path) -> list[Path]:
    """Return the folders that have to be made for this one, the innermost first."""
    return [path for path in (folder, *folder.parents) if not path.exists()]


def _remove(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):  # another program uses it now
            folder.rmdir()


def _sweep(path: Path) -> None:
    """Remove what a process that was killed has left beside a file."""
    for partial in path.parent.glob(f".{path.name}.*{PARTIAL}"):
        partial.unlink()


def _replace(path: Path, data: bytes, mode: int, owner: tuple[int, ...] | None = None) -> None:
    """Write a file whole, or not at all."""
    _sweep(path)
    with replacing(path, mode=mode) as new:
        new.write_bytes(data)
        new.chmod(mode)
        if owner is not None and (os.getuid(), os.getgid()) != owner:
            os.chown(new, *owner)


@contextlib.contextmanager
def _explained() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        advice = "; run it as root" if isinstance(error, PermissionError) else ""
        raise HostSetupError(f"{error.filename}: {error.strerror}{advice}; --undo takes back what was done") from None
