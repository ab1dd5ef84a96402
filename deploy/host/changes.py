"""What a set-up changes: files that stay, knobs of the running kernel, commands with what takes them back."""

import difflib
from dataclasses import dataclass

Bytes = bytes | None


@dataclass(frozen=True, slots=True)
class File:
    """A file to write whole. path: absolute on the machine; why: what it is for, and what it costs."""

    path: str
    content: str
    why: str
    mode: int = 0o644

    def shown(self, before: Bytes) -> str:
        """Return the change as a unified diff against the present content, None where there is no file."""
        old = [] if before is None else before.decode(errors="replace").splitlines(keepends=True)
        source = "/dev/null" if before is None else self.path
        return "".join(difflib.unified_diff(old, self.content.splitlines(keepends=True), source, self.path))


@dataclass(frozen=True, slots=True)
class Knob:
    """A value under /sys or /proc, of the running kernel alone: it is gone after a restart."""

    path: str
    value: str
    why: str

    def shown(self, before: Bytes) -> str:
        """Return the change in one line."""
        was = "" if before is None else before.decode(errors="replace").strip()
        return f"{self.path}: {was} -> {self.value}\n"


@dataclass(frozen=True, slots=True)
class Command:
    """A command to run, and what takes it back; either may be empty: undoing runs in the opposite order."""

    do: tuple[str, ...]
    undo: tuple[str, ...]
    why: str

    def shown(self) -> str:
        """Return both in one line each."""
        lines = [f"$ {' '.join(self.do)}\n"] if self.do else []
        return "".join(lines + ([f"  --undo: {' '.join(self.undo)}\n"] if self.undo else []))


Change = File | Knob | Command
