"""`rtstack recover-arms`: what the arms have latched, and its recovery, without starting anything again."""

import typer

from hal.errors import RecoveryRefused
from hal.fci import open_pair
from rtstack.cli.cells import fci_addresses

FAILED = 1


def recover_arms(kind: str) -> None:
    """Say of each arm what it has latched, and recover it; exit status 1 where the cause persists.

    Raises TrialError for anything but fci:LEFT,RIGHT, HardwareError from the arms.
    """
    pair = open_pair(*fci_addresses(kind))
    try:
        for arm in (pair.left, pair.right):
            names = arm.reflex()
            typer.echo(f"{arm.address}: " + (f"in reflex: {', '.join(names)}" if names else "in no reflex"))
        for line in pair.recover():
            typer.echo(line)
    except RecoveryRefused as error:
        typer.echo(f"rtstack: {error}", err=True)
        raise typer.Exit(FAILED) from None
    finally:
        pair.close()
