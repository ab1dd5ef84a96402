"""`rtstack desk`: all boxes of a cell at once, each in its own thread: a slow one keeps no other waiting."""

import getpass
import json as json_module
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from hal.desk import Desk, SignIn, Trust
from hal.desk.power import start as start_box
from hal.desk.power import stop as stop_box
from hal.errors import HardwareError
from rtstack.cli.options import CellFile, Json
from rtstack.trials.errors import TrialError

commands = typer.Typer()
desk = typer.Typer(help="Desk of both control boxes: brakes, FCI, self-test, shutting down.")
commands.add_typer(desk, name="desk")
LeftDesk = Annotated[str | None, typer.Option("--left", metavar="HOST[:PORT]", help="Desk of the left arm's box.")]
RightDesk = Annotated[str | None, typer.Option("--right", metavar="HOST[:PORT]", help="Desk of the right arm's box.")]
USER, PASSWORD = "RTSTACK_DESK_USER", "RTSTACK_DESK_PASSWORD"


@desk.command("status")
def status(left: LeftDesk = None, right: RightDesk = None, cell_file: CellFile = None, json: Json = False) -> None:
    """Say what both boxes say of themselves; it changes nothing."""
    addresses = _addresses(left, right, cell_file)
    trust, states = _met(addresses), {}
    for side, address in addresses.items():
        with closing(Desk(address, trust, _sign_in(ask=False), f"{side} box")) as box:
            states[side] = box.state()
    if json:
        typer.echo(json_module.dumps({side: {**asdict(state), "ready": state.ready} for side, state in states.items()}))
        return
    for side, state in states.items():
        address = addresses[side]
        due = "" if state.self_test_s is None else f", due in {state.self_test_s / 3600.0:.1f} h"
        typer.echo(
            f"{side} box, {address}: {'ready' if state.ready else 'not ready'}: brakes {state.brakes}, "
            f"FCI {state.fci}, mode {state.operating_mode}, control {state.control or 'free'}, "
            f"self-test {state.self_test}{due}, system {state.version}, serial {state.serial}"
        )
        for line in (*state.obstacles, *filter(None, [state.warning])):
            typer.echo(f"{side} box: {line}")


@desk.command("start")
def start(
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
    addresses = _addresses(left, right, cell_file)
    if self_test:
        _refuse_in_use(addresses, cell_file)
    _each(addresses, lambda box, trust, address: start_box(box, trust, address, self_test))


@desk.command("stop")
def stop(left: LeftDesk = None, right: RightDesk = None, cell_file: CellFile = None) -> None:
    """End FCI, lock the brakes, give control on Desk back."""
    _stop(left, right, cell_file, shut_down=False)


@desk.command("shutdown")
def shutdown(left: LeftDesk = None, right: RightDesk = None, cell_file: CellFile = None) -> None:
    """Do what stop does, and shut both boxes down: before they are switched off."""
    _stop(left, right, cell_file, shut_down=True)


def _stop(left: str | None, right: str | None, cell_file: Path | None, shut_down: bool) -> None:
    addresses = _addresses(left, right, cell_file)
    _refuse_in_use(addresses, cell_file)
    _each(addresses, lambda box, trust, address: stop_box(box, trust, address, shut_down))


def _addresses(left: str | None, right: str | None, cell_file: Path | None) -> dict[str, str]:
    """Return where Desk of each box is, by side: of the addresses that are given alone, else of the cell's file."""
    from rtstack.cells import load_description
    from rtstack.samples import SIDES

    description, source = load_description(cell_file)
    asked = {side: address for side, address in (("left", left), ("right", right)) if address}
    found = {side: asked.get(side, arm.desk) for side, arm in description.mountings.items() if side in (asked or SIDES)}
    if not found or not all(found.values()):
        raise TrialError(
            "where is Desk of the boxes? Give --left or --right HOST[:PORT], or both, or --cell-file with "
            f'desk = "HOST" under {" and ".join(f"[{side}]" for side in description.sides)} ({source} has none)'
        )
    if len(set(found.values())) < len(found):
        raise TrialError(f"two boxes have two addresses: Desk of both would be at {found['left']}")
    return found


def _each(addresses: Mapping[str, str], steps: Callable[[Desk, Trust, str], Iterator[str]]) -> None:
    trust, sign_in = _met(addresses), _sign_in(ask=True)

    def run(side: str, address: str) -> str:
        try:
            with closing(Desk(address, trust, sign_in, f"{side} box")) as box:
                for line in steps(box, trust, address):
                    typer.echo(f"{side} box: {line}")
        except (HardwareError, OSError) as error:
            return str(error)
        return ""

    with ThreadPoolExecutor(len(addresses)) as pool:
        refusals = [line for line in pool.map(run, addresses, addresses.values()) if line]
    if refusals:
        raise HardwareError("; ".join(refusals))


def _met(addresses: Mapping[str, str]) -> Trust:
    """Remember the certificates of boxes that this user has not used before, and say so."""
    trust = Trust()
    for side, address in addresses.items():
        if trust.knows(address):
            continue
        try:
            known = trust.remember(address)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise HardwareError(
                f"Desk of the {side} box at {address} does not answer: {reason}; is the box on, and the address right?"
            ) from None
        typer.echo(
            f"rtstack: first use of Desk of the {side} box at {address}: its certificate is {known}. Compare it with "
            f"what a browser shows there; from now on no other one is accepted ({trust.file(address)})", err=True,
        )  # fmt: skip
    return trust


def _sign_in(ask: bool) -> SignIn | None:
    user, password = os.environ.get(USER), os.environ.get(PASSWORD)
    if user and password:
        return SignIn(user, password)
    if not ask:
        return None
    if not sys.stdin.isatty():
        raise TrialError(f"Desk's user and password: set {USER} and {PASSWORD}, or give the command in a terminal")
    print("User of Desk: ", end="", file=sys.stderr, flush=True)
    return SignIn(user or sys.stdin.readline().strip(), getpass.getpass("Password of Desk: "))


def _refuse_in_use(addresses: Mapping[str, str], cell_file: Path | None) -> None:
    """Raise TrialError where a stack on this machine may move these arms."""
    from rtstack.cells import load_description
    from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable, running_stacks
    from rtstack.live.protocol import Phase

    arms = {address.partition(":")[0] for address in addresses.values()}
    if cell_file is not None:
        arms |= {arm.address for arm in load_description(cell_file)[0].arms}
    for socket in running_stacks():
        try:
            with closing(RobotClient(socket)) as client:
                state = client.status()
        except (RobotRefused, RobotUnreachable):
            continue
        if set(state.cell.partition(":")[2].split(",")) & arms and state.phase not in (Phase.DISARMED, Phase.FAULT):
            raise TrialError(f"a stack has these arms and is {state.phase} ({socket}): disarm it first")
