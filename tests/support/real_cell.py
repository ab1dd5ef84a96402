"""The file of a cell whose arms are not simulated: measured today and commissioned, at addresses of its own."""

from datetime import date
from pathlib import Path

from rtstack.cells import default_cell_file, load_description
from rtstack.cells.commissioning import record_file, sign, steps

CALIBRATED = f"[calibration]\ndate = {date.today()}\nrms_mm = 1.2\n"


def write_cell_file(path: Path, left: str, right: str, tracker: str = "127.0.0.1:1341") -> str:
    """Write it with its complete record of commissioning, and return its text."""
    text = default_cell_file().read_text(encoding="utf-8").replace("simulated = true", "simulated = false")
    text = text.replace(
        "simulated = false", "enforce_realtime = false # this machine's kernel is what it is\nsimulated = false"
    )
    for old, new in (("127.0.0.11", left), ("127.0.0.12", right), ("127.0.0.1:1341", tracker)):
        assert old in text
        text = text.replace(f'"{old}"', f'"{new}"')
    text = f"{text}\n{CALIBRATED}"
    path.write_text(text, encoding="utf-8")
    commission(path)
    return text


def commission(path: Path, until: str = "") -> None:
    """Sign all steps of a cell's file as it is now, or those before a step, in place of what was signed."""
    record_file(path).unlink(missing_ok=True)
    description = load_description(path)[0]
    for step in steps(description):
        if step.name == until:
            break
        sign(step.name, "a test", {}, description, path)
