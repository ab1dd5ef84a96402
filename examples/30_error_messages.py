"""Errors say what is wrong and what to do, in one line; the same text in Python, at the terminal and on the page."""

import subprocess
from pathlib import Path

from hal.base.configuration import ConfigurationError
from hal.errors import HardwareError
from rtstack.cells import default_cell_file, load_description, open_cell

description, _ = load_description(None)
wrong = Path("wrong.toml")
wrong.write_text(default_cell_file().read_text().replace("mass = 1.25", "mass = -1.25", 1))


def a_cell_with_a_wrong_number():
    load_description(wrong)


def an_unknown_object():
    open_cell("direct", "rice_bocks", 0.0, 0, description)


def an_arm_that_is_not_there():
    open_cell("fci:127.0.99.1,127.0.99.2", "rice_box", 0.0, 0, description)


for attempt in (a_cell_with_a_wrong_number, an_unknown_object, an_arm_that_is_not_there):
    try:
        attempt()
    except (ConfigurationError, HardwareError) as error:
        print(f"{attempt.__name__.replace('_', ' ')}: {error}")

done = subprocess.run(["rtstack", "trial", "--reference", "none.mcap"], capture_output=True, text=True, check=False)
print(f"at the terminal, status {done.returncode}: {done.stderr.strip()}")
