"""`rtstack demo`: the whole way once: a demonstration, a trial of it, its review, and a page of its impact."""

import os
import webbrowser
from pathlib import Path

import typer

from hal.extras import advice
from rtstack.cli.logs import review
from rtstack.cli.trials import teach, trial
from rtstack.log.errors import LogError
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification

OBJECT, DISPLACEMENT_MM = "rice_box", -30.0


def run(folder: Path, browser: bool) -> None:
    """Write both logs and the page into a new folder. Raises LogError where it is there already or cannot be made.

    browser: open the page, where there is a display.
    """
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
    typer.echo("\n4. Its impact, as a page.")
    _show_impact(log, folder / "impact.html", browser)
    typer.echo("\nNext: `rtstack up` starts the console.")


def _show_impact(log: Path, page: Path, browser: bool) -> None:
    try:
        from rtstack.cli.plot import plot
    except ModuleNotFoundError as error:
        if not (lacking := advice(error.name)):
            raise
        typer.echo(f"left out: {lacking}")
        return
    plot([str(log)], "html", page, impact=True)
    # a browser that needs no display would take the terminal
    displayed = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if not (browser and displayed and webbrowser.open(page.absolute().as_uri())):
        typer.echo(f"open it in a browser: {page.absolute().as_uri()}")
