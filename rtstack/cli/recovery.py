"""`rtstack recover` a log that was cut off; `rtstack recover-arms`, the way out of a fault without starting anew."""

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from hal.base.shared import user_name
from hal.errors import RecoveryRefused
from rtstack.cli.exit_status import fail
from rtstack.cli.progress import progress_bar
from rtstack.log.file.recover import recover as recover_log
from rtstack.trials.errors import TrialError

commands = typer.Typer()
_LONGEST_NAME = 28  # an operator's is 40


@commands.command()
def recover(log: Annotated[Path, typer.Argument(metavar="LOG.mcap")]) -> None:
    """Make a complete log of one that was cut off or damaged. The original stays as it is."""
    with progress_bar("recovering", True) as show:
        summary = recover_log(log, progress=lambda done, total: show(done / total))
    if summary.complete:
        typer.echo(f"{log} is complete: nothing to recover")
        return
    what = f"; {len(summary.missing)} parts could not be read:" if summary.missing else ""
    found = f"recovered {summary.messages} messages, up to {summary.last_t_ns * 1e-9:.3f} s"
    typer.echo("\n  ".join([f"{found}, to {summary.output}{what}", *summary.missing]))


@commands.command("recover-arms")
def recover_arms(
    cell: Annotated[str | None, typer.Option(help="fci:LEFT,RIGHT; by default the arms of the running stack.")] = None,
    stack: Annotated[
        Path | None, typer.Option(metavar="SOCKET", help="Which stack, where several are running.")
    ] = None,
) -> None:
    """Clear what the arms have latched (a fault, a reflex), once its cause is gone."""
    from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable, only_stack

    if cell is not None and stack is not None:
        raise TrialError("--cell or --stack, not both: a running stack has its arms itself")
    if cell is not None:
        _recover_pair(cell)
        return
    socket = stack or only_stack("--stack SOCKET")
    user = "".join(letter for letter in user_name() if letter.isprintable()).strip()
    try:
        with closing(RobotClient(socket)) as client:
            status = client.status()
            typer.echo(f"{status.cell}: {status.phase}" + (f": {status.reason}" if status.reason else ""))
            status = client.recover(f"{user[:_LONGEST_NAME]}, terminal")
            typer.echo(f"{status.cell}: {status.phase}: take control and arm to go on")
    except RobotRefused as error:
        fail(str(error))
    except RobotUnreachable as error:
        raise TrialError(f"{socket}: {error}") from None


def _recover_pair(kind: str) -> None:
    # and with it pylibfranka, which not every Python has, and a stack's recovery does without
    from hal.fci import open_pair
    from rtstack.cells.fci import fci_addresses, own_limits

    addresses = fci_addresses(kind)
    own_limits(tuple(addresses.values()))  # raises where no robot answers
    try:
        with closing(open_pair(addresses.get("left"), addresses.get("right"))) as pair:
            for arm in pair.arms.values():
                names = arm.reflex()
                typer.echo(f"{arm.address}: " + (f"in reflex: {', '.join(names)}" if names else "in no reflex"))
            for line in pair.recover():
                typer.echo(line)
    except RecoveryRefused as error:
        fail(str(error))
