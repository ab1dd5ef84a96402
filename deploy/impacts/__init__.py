"""Scenes of impacts, for `rtstack impact-map`."""

from importlib.resources import as_file, files
from pathlib import Path


def impact_file(name: str) -> Path:
    """Return the path of a scene by its name, such as grab."""
    with as_file(files("deploy.impacts") / f"{name}.toml") as path:
        return path
