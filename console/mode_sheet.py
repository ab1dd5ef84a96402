"""The modes for pages and programs, from rtstack.palette: a style sheet, and the words for the scripts.

A mode's colour is `--mode` below any element with `data-mode`, and `--mode-NAME` everywhere.
"""

from rtstack.palette import MODE_STYLES

SHEET_PATH = "/static/css/modes.css"  # open to everybody, as all style is
MODE_WORDS = {mode.name: style.word for mode, style in MODE_STYLES.items()}


def mode_sheet() -> str:
    """Return the style sheet."""
    dark = " ".join(f"{variable(mode.name)}: {style.colour};" for mode, style in MODE_STYLES.items())
    light = " ".join(f"{variable(mode.name)}: {style.light};" for mode, style in MODE_STYLES.items())
    each = "\n".join(f'[data-mode="{mode.name}"] {{ --mode: var({variable(mode.name)}); }}' for mode in MODE_STYLES)
    return f':root {{ {dark} }}\n:root[data-theme="light"] {{ {light} }}\n{each}\n'


def variable(name: str) -> str:
    """Return the CSS variable that has a mode's colour."""
    return f"--mode-{name.lower().replace('_', '-')}"
