"""A wheel, built as pip does from the files of this clone, and what is in it."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 120.0


def copy_sources(folder: Path) -> None:
    """Copy the files of the clone from which a wheel is built, as they are now."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if name.startswith(("tests/", "docs/")) or not (ROOT / name).exists():
            continue
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name, follow_symlinks=True)


def build(source: Path, folder: Path) -> Path:
    """Build a wheel from a folder into another one, as pip does; return it."""
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--disable-pip-version-check"]
    subprocess.run([*wheel, "-w", str(folder), str(source)], check=True, timeout=TIMEOUT_S)
    (file,) = folder.glob("*.whl")
    return file


def install(source: Path, place: Path) -> None:
    """Build a wheel from a folder, and put what is in it into another one."""
    with zipfile.ZipFile(build(source, place.with_name(f"{place.name}-wheel"))) as archive:
        archive.extractall(place)
