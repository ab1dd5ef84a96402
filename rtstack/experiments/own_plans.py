"""Plans of the user's own: TOML files in a folder of theirs, found by name like those of the package."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from hal.base.configuration import ConfigurationError
from hal.base.files import PARTIAL, replacing
from hal.base.shared import user_folder


def plan_folder() -> Path:
    """Return the folder of the user's own plans, a NAME.toml each. Raises ConfigurationError."""
    return user_folder("XDG_CONFIG_HOME", ".config") / "campaigns"


def own_plans() -> dict[str, Path]:
    """Return the user's own plans by name, none without a home; they are checked when they are read."""
    with suppress(ConfigurationError):
        return {path.stem: path for path in sorted(plan_folder().glob("*.toml"))}
    return {}


def keep_plan(name: str, text: str, read: Callable[[Path], Any]) -> Path:
    """Write a plan into the user's folder, as a new file that `read` accepts. Raises ConfigurationError, nothing
    written.
    """
    path = plan_folder() / f"{name}.toml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            raise ConfigurationError(f"name: there is a plan {name} already, {path}; take another name")
        with replacing(path) as new:
            new.write_text(text, encoding="utf-8")
            try:
                read(new)
            except ConfigurationError as error:
                line = str(error).partition(PARTIAL)[2].lstrip(":0123456789 ") or str(error)
                raise ConfigurationError(line) from None
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
    return path
