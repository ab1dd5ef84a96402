"""`python -m rtstack.papers.aim_aware.arm.one_hit fci:ADDRESS`: one hit by an arm at its address, with its log.

The arm goes to the start of the plan by itself. The platform has to stand where the plan has it: x 0.51 m, height
0.15 m. A simulated one: `rtstack sim --scene platform`.
"""

import argparse
import sys
from pathlib import Path

from hal.base.configuration import ConfigurationError
from hal.errors import HardwareError
from rtstack.cells import profile_of
from rtstack.cli.terminal import Terminal
from rtstack.experiments.registry import plan_file
from rtstack.log.errors import LogError
from rtstack.papers.aim_aware.arm.hits import plan_case, prepare_hit
from rtstack.papers.aim_aware.arm.study import STUDY, load_arm_run
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.platform.hit import Hit
from rtstack.papers.aim_aware.platform.setup import platform_cell_file
from rtstack.trials.carry_out import carry_out
from rtstack.trials.errors import TrialError


def one_hit(kind: str, approach_deg: float, path: Path) -> tuple[Hit, dict[str, str]]:
    """Run one hit on a kind of cell and write its log. Returns the hit, and each tuning's verdict on it.

    Raises ConfigurationError, LogError, TrialError, HardwareError.
    """
    if profile_of(kind):
        raise TrialError(
            f"cell {kind!r} has no platform: give an arm's address, fci:ADDRESS (rtstack sim --scene platform)"
        )
    run = load_arm_run(plan_file(STUDY).path, quick=False)
    if (twist := run.tuned.learned.get(f"{approach_deg:g}")) is None:
        raise TrialError(f"--approach-deg {approach_deg:g}: choose one of {', '.join(run.tuned.learned)}")
    study, monitors = run.study, run.monitors()
    case = Case(approach_deg, study.grid.location_m.first, 0.0)
    plan = plan_case(study, case, twist)
    prepared = prepare_hit(study, case, plan, next(iter(monitors.values())), 0)
    host = Terminal(kind, study.description, platform_cell_file(), "a hit of the platform", log_path=path)
    done = carry_out(prepared, host)
    impact = Impact(case, plan, done.ticks)
    return done, {name: impact.assess(parameters).verdict.name.lower() for name, parameters in monitors.items()}


def main(arguments: list[str] | None = None) -> int:
    """Run the command. Returns its exit status."""
    parser = argparse.ArgumentParser(prog="one_hit", description="One hit of the platform, with its log.")
    parser.add_argument("cell", help="fci:ADDRESS")
    parser.add_argument("--log", type=Path, default=Path("hit.mcap"), help="the file to write")
    parser.add_argument("--approach-deg", type=float, default=100.0, help="of the pad's motion; 90: straight down")
    options = parser.parse_args(arguments)
    try:
        done, verdicts = one_hit(options.cell, options.approach_deg, options.log)
    except (ConfigurationError, HardwareError, LogError, TrialError) as error:
        print(f"one_hit: {error}", file=sys.stderr)
        return 2
    said = ", ".join(f"{name} {verdict}" for name, verdict in verdicts.items())
    print(f"{options.log}: {done.failure_reason or said}")
    return 0 if done.success else 1


if __name__ == "__main__":
    sys.exit(main())
