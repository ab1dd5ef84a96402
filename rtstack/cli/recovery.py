"""`rtstack recover-arms`: the way out of a fault of a running stack, or of bare arms, without starting anew."""

import getpass
from pathlib import Path

import typer

from hal.errors import RecoveryRefused
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable, running_stacks
from rtstack.trials.errors import TrialError

FAILED = 1
_LONGEST_NAME = 28  # an operator's is 40


def recover_arms(kind: str | None, stack: Path | None) -> None:
    """Recover the arms of a kind of cell, or else those of the stack that runs; exit status 1 where that is refused.

    Raises TrialError for anything but fci:LEFT,RIGHT, and where no stack answers; HardwareError from the arms.
    """
    if kind is not None and stack is not None:
        raise TrialError("--cell or --stack, not both: a running stack has its arms itself")
    if kind is None:
        _recover_stack(stack or _only_stack())
    else:
        _recover_pair(kind)


def _recover_stack(socket: Path) -> None:
    client = RobotClient(socket)
    try:
        status = client.status()
        typer.echo(f"{status.cell}: {status.phase}" + (f": {status.reason}" if status.reason else ""))
        status = client.recover(_operator())
        typer.echo(f"{status.cell}: {status.phase}: take control and arm to go on")
    except RobotRefused as error:
        _refuse(str(error))
    except RobotUnreachable as error:
        raise TrialError(f"{socket}: {error}") from None
    finally:
        client.close()


def _recover_pair(kind: str) -> None:
    # and with it pylibfranka, which not every Python has, and a stack's recovery does without
    from hal.fci import open_pair
    from rtstack.cells.fci import fci_addresses

    pair = open_pair(*fci_addresses(kind))
    try:
        for arm in (pair.left, pair.right):
            names = arm.reflex()
            typer.echo(f"{arm.address}: " + (f"in reflex: {', '.join(names)}" if names else "in no reflex"))
        for line in pair.recover():
            typer.echo(line)
    except RecoveryRefused as error:
        _refuse(str(error))
    finally:
        pair.close()


def _only_stack() -> Path:
    found = running_stacks()
    if not found:
        raise TrialError(
            "no stack is running: start one with `rtstack up`, or name the arms with --cell fci:LEFT,RIGHT"
        )
    if len(found) > 1:
        raise TrialError(f"{len(found)} stacks are running: name one with --stack: {', '.join(map(str, found))}")
    return found[0]


def _operator() -> str:
    try:
        user = "".join(letter for letter in getpass.getuser() if letter.isprintable()).strip()
    except (OSError, KeyError):  # a user without a name
        user = ""
    return f"{user[:_LONGEST_NAME] or 'unknown user'}, terminal"


def _refuse(reason: str) -> None:
    typer.echo(f"rtstack: {reason}", err=True)
    raise typer.Exit(FAILED)
