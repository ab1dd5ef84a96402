"""What a set-up changes: files that stay, knobs of the running kernel, commands with what takes them back."""

import difflib
from dataclasses import dataclass

from deploy.host.machine import HostSetupError, Machine


@dataclass(frozen=True, slots=True)
class File:
    """A file to write whole. path: absolute on the machine; why: what it is for, and what it costs."""

    path: str
    content: str
    why: str
    mode: int = 0o644

    def shown(self, machine: Machine) -> str:
        """Return the change as a unified diff against the present content. Raises HostSetupError."""
        try:
            before, source = machine.at(self.path).read_bytes().decode(errors="replace"), self.path
        except FileNotFoundError:
            before, source = "", "/dev/null"
        except OSError as error:
            raise HostSetupError(f"{self.path}: {error.strerror}; run it as root") from None
        old, new = before.splitlines(keepends=True), self.content.splitlines(keepends=True)
        return "".join(difflib.unified_diff(old, new, source, self.path))


@dataclass(frozen=True, slots=True)
class Knob:
    """A value under /sys or /proc, of the running kernel alone: it is gone after a restart."""

    path: str
    value: str
    why: str

    def shown(self, machine: Machine) -> str:
        """Return the change in one line."""
        return f"{self.path}: {machine.text(self.path)} -> {self.value}\n"


@dataclass(frozen=True, slots=True)
class Command:
    """A command to run, and what takes it back; either may be empty: undoing runs in the opposite order."""

    do: tuple[str, ...]
    undo: tuple[str, ...]
    why: str

    def shown(self, machine: Machine) -> str:
        """Return both in one line each."""
        lines = [f"$ {' '.join(self.do)}\n"] if self.do else []
        return "".join(lines + ([f"  --undo: {' '.join(self.undo)}\n"] if self.undo else []))


Change = File | Knob | Command
