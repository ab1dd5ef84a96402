"""What the hour leaves: a file a step, one zip, a table. No name of a user, a PC or a network is in it."""

import getpass
import json
import platform
import re
import zipfile
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.hour.figures import rounded
from tests.support.hour.lab import Found, Lab, Step

VERDICTS = {True: "as claimed", False: "DIFFERS", None: "not seen"}


class Results:
    """The results in a folder, by step; a step that is there was done. What identifies the lab is replaced."""

    def __init__(self, lab: Lab) -> None:
        self.folder = lab.folder
        arm = lab.mounting
        hidden = {lab.address: "ARM", arm.address: "ARM", arm.desk: "DESK", arm.serial: "SERIAL"}
        hidden |= {str(lab.cell_file): "CELL.toml", str(lab.folder): "FOLDER", str(Path.home()): "HOME"}
        hidden |= {platform.node(): "HOST"}
        with suppress(OSError, KeyError):
            hidden[getpass.getuser()] = "USER"
        self._hidden = sorted(((k, v) for k, v in hidden.items() if k), key=lambda pair: -len(pair[0]))

    def path(self, step: Step) -> Path:
        """Return where the result of a step is."""
        return self.folder / f"{step.number:02d}-{step.key}.json"

    def scrubbed(self, text: str) -> str:
        """Return a text without what identifies the lab."""
        for name, word in self._hidden:
            text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", word, text)  # not in the middle of a word
        return text

    def write(self, step: Step, found: Found, failed: str = "", skipped: str = "") -> None:
        """Write the result of a step, and its arrays beside it."""
        record: dict[str, Any] = {
            "step": step.number, "key": step.key, "title": step.title, "failed": failed, "skipped": skipped,
            "day": datetime.now(UTC).date().isoformat(), "claims": [asdict(claim) for claim in found.claims],
            "figures": rounded(found.figures), "arrays": sorted(found.arrays),
        }  # fmt: skip
        if found.arrays:
            data = BytesIO()
            np.savez_compressed(data, **found.arrays)  # pyright: ignore[reportArgumentType]
            self.path(step).with_suffix(".npz").write_bytes(data.getvalue())
        self.path(step).write_text(self.scrubbed(json.dumps(record, indent=1)) + "\n", encoding="utf-8")

    def read(self, step: Step) -> dict[str, Any] | None:
        """Return the result of a step, None where there is none."""
        path = self.path(step)
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None

    def table(self, steps: tuple[Step, ...]) -> str:
        """Return the table of claimed and found, as Markdown."""
        lines = ["| step | what | claimed | found | |", "|---|---|---|---|---|"]
        for step in steps:
            record = self.read(step)
            name = f"{step.number} {step.title}"
            if record is None:
                lines.append(f"| {name} | - | - | not run | |")
                continue
            for claim in record["claims"]:
                cells = [name, claim["what"], claim["claimed"], claim["found"], VERDICTS[claim["as_claimed"]]]
                lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
            for why in ("failed", "skipped"):
                if record[why]:
                    lines.append(f"| {name} | - | - | {why}: {record[why].replace('|', '/')} | |")
        return "\n".join(lines) + "\n"

    def zipped(self, steps: tuple[Step, ...], side: str) -> Path:
        """Write the zip with all results and the table, and return it."""
        path = self.folder / f"one_hour-{side}-{datetime.now(UTC).date()}.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("table.md", self.table(steps))
            archive.writestr("README.md", _README)
            for step in steps:
                for file in (self.path(step), self.path(step).with_suffix(".npz")):
                    if file.exists():
                        archive.write(file, file.name)
        return path


_README = """One hour on one arm: what rtstack counts on, beside what was found.

table.md: claimed and found. NN-name.json: claims and figures of a step; the unit is the end of a figure's name (rad,
nm, n, ms, hz, kg, ppm). NN-name.npz: what the arm has shown, a row a millisecond, by the names of libfranka: q, dq,
tau_J, tau_J_d, ...; t_ns: the robot's time; tau_sent: what answered the state, Nm; sent: whether it was sent; read_ns,
answered_ns: the PC's monotonic time. What each step decides: docs/runbook/unproven.md.
"""
