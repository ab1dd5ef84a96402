"""A machine as its files show it, below any root: what there is to set up, and how it is set up now."""

import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

Run = Callable[[tuple[str, ...]], str]


class HostSetupError(Exception):
    """The set-up cannot be planned, applied or taken back. The message is one line that says what to do."""


def run_here(command: tuple[str, ...]) -> str:
    """Run a command on this machine and return what it prints. Raises HostSetupError."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise HostSetupError(f"{command[0]}: {error.strerror}; install it, and apply again") from None
    if done.returncode:
        reason = " ".join((done.stderr or done.stdout).split())
        raise HostSetupError(f"`{' '.join(command)}` failed: {reason or f'exit status {done.returncode}'}")
    return done.stdout


class Machine:
    """The tree below `root`. run: runs its commands; None where the tree is not the one that runs."""

    def __init__(self, root: Path = Path("/"), run: Run | None = None) -> None:
        self.root = root
        self.run = run_here if run is None and root.resolve() == Path("/") else run
        if not (root / "etc").is_dir():
            raise HostSetupError(f"{root}: has no folder etc: it is no root of a machine")

    def at(self, path: str) -> Path:
        """Return where an absolute path of the machine is."""
        return self.root / path.lstrip("/")

    def text(self, path: str) -> str:
        """Return a file's text, stripped, empty without one."""
        with suppress(OSError):
            return self.at(path).read_text(errors="replace").strip()
        return ""

    def names(self, pattern: str) -> list[str]:
        """Return the absolute paths, on the machine, that match a pattern."""
        return sorted("/" + str(path.relative_to(self.root)) for path in self.root.glob(pattern.lstrip("/")))

    @property
    def groups(self) -> dict[str, list[str]]:
        """Members of each group in /etc/group."""
        rows = [line.split(":") for line in self.text("/etc/group").splitlines()]
        return {row[0]: [name for name in row[3].split(",") if name] for row in rows if len(row) == 4}

    @property
    def users(self) -> set[str]:
        """Names in /etc/passwd."""
        return {line.split(":")[0] for line in self.text("/etc/passwd").splitlines()}


def cpu_list(text: str) -> list[int]:
    """Return the CPUs of a list as the kernel writes it, such as 0-2,5. Raises HostSetupError."""
    cpus: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.partition("-")
            cpus += range(int(first), int(last or first) + 1)
    except ValueError:
        raise HostSetupError(f"/sys/devices/system/cpu/online says {text!r}: that is no list of CPUs") from None
    return cpus


def cpu_text(cpus: list[int]) -> str:
    """Return CPUs, in ascending order, as the kernel writes them: 0-2,5."""
    rows: list[list[int]] = []
    for cpu in cpus:
        if rows and rows[-1][-1] == cpu - 1:
            rows[-1].append(cpu)
        else:
            rows.append([cpu])
    return ",".join(str(row[0]) if len(row) == 1 else f"{row[0]}-{row[-1]}" for row in rows)
