"""`rtstack desk`."""

from typing import Annotated

import typer

from rtstack.cli.commands.options import CellFile, Json

commands = typer.Typer(help="Desk of both control boxes: brakes, FCI, self-test, shutting down.")
LeftDesk = Annotated[str | None, typer.Option("--left", metavar="HOST[:PORT]", help="Desk of the left arm's box.")]
RightDesk = Annotated[str | None, typer.Option("--right", metavar="HOST[:PORT]", help="Desk of the right arm's box.")]


@commands.command("status")
def desk_status(left: LeftDesk = None, right: RightDesk = None, cell_file: CellFile = None, json: Json = False) -> None:
    """Say what both boxes say of themselves; it changes nothing."""
    from rtstack.cli.desk import status as run

    run(left, right, cell_file, json)


@commands.command("start")
def desk_start(
    left: LeftDesk = None,
    right: RightDesk = None,
    cell_file: CellFile = None,
    self_test: Annotated[
        bool, typer.Option("--self-test", help="Run the daily safety self-test before; no person within reach.")
    ] = False,
) -> None:
    """Take control on Desk, unlock the brakes, activate FCI.

    User and password are those of Desk: from RTSTACK_DESK_USER and RTSTACK_DESK_PASSWORD, else they are asked for.
    """
    from rtstack.cli.desk import start as run

    run(left, right, cell_file, self_test)


@commands.command("stop")
def desk_stop(left: LeftDesk = None, right: RightDesk = None, cell_file: CellFile = None) -> None:
    """End FCI, lock the brakes, give control on Desk back."""
    from rtstack.cli.desk import stop as run

    run(left, right, cell_file, shut_down=False)


@commands.command("shutdown")
def desk_shutdown(left: LeftDesk = None, right: RightDesk = None, cell_file: CellFile = None) -> None:
    """Do what stop does, and shut both boxes down: before they are switched off."""
    from rtstack.cli.desk import stop as run

    run(left, right, cell_file, shut_down=True)
