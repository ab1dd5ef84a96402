"""Tunes the aim-aware arm study on its coarse grid: `python -m rtstack.cli.arm_tuning`. Deterministic."""

import argparse
from pathlib import Path

from rich.progress import track

from rtstack.cli.platform_cell import open_platform_cell, platform_files
from rtstack.configuration import ConfigurationError
from rtstack.studies.aim_aware.arm.study import load_arm_study
from rtstack.studies.aim_aware.arm.tuning import as_toml, tune

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Write deploy/tunings/NAME.toml."""
    parser = argparse.ArgumentParser(description="Tune the arm study on its coarse grid.")
    parser.add_argument("study", nargs="?", type=Path, default=ROOT / "deploy/campaigns/aim-aware-arm.toml")
    path = parser.parse_args().study
    try:
        name = load_arm_study(path).name
        text = as_toml(tune(path, open_platform_cell, platform_files(), track), name)
    except ConfigurationError as error:
        parser.exit(2, f"rtstack: {error}\n")
    except KeyboardInterrupt:
        parser.exit(1, "rtstack: interrupted, nothing was written\n")
    target = ROOT / "deploy/tunings" / f"{name}.toml"
    target.write_text(text, encoding="utf-8")
    print(f"{target}\n\n{text}", end="")


if __name__ == "__main__":
    main()
