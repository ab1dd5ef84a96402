"""`rtstack demo`: the whole way once, in a terminal: a demonstration, a trial of it, the review of its log."""

from pathlib import Path

import typer

from rtstack.cli.logs import review
from rtstack.cli.trials import teach, trial
from rtstack.log.errors import LogError
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification

OBJECT, DISPLACEMENT_MM = "rice_box", -30.0


def run(folder: Path) -> None:
    """Write both logs into a new folder. Raises LogError where it is there already or cannot be made."""
    recording, log = folder / "demonstration.mcap", folder / "trial.mcap"
    try:
        folder.mkdir()
    except OSError as error:
        raise LogError(f"cannot make the folder {folder}: {error.strerror}; choose another one with --out") from error
    typer.echo(f"1. A scripted hand leads both arms to the object {OBJECT}, which they grab by hitting it.")
    teach(recording, DemonstrationSpecification(OBJECT), "direct", None, False)
    typer.echo(f"\n2. A trial follows that recording; the object is {-DISPLACEMENT_MM:.0f} mm nearer to the right arm.")
    asked = TrialSpecification(str(recording), object=OBJECT, displacement_mm=DISPLACEMENT_MM)
    trial(asked, log, "direct", None, False)
    typer.echo("\n3. The review of its log.")
    review(log, False)
    typer.echo(f"\nNext: `rtstack plot {log} --impact --html` draws the impact, `rtstack up` opens the page.")
