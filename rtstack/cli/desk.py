"""`rtstack desk`: both boxes of a cell at once, each in its own thread: a slow one keeps no other waiting."""

import getpass
import json
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import typer

from hal.desk import Desk, DeskState, SignIn, Trust
from hal.desk.power import start as start_box
from hal.desk.power import stop as stop_box
from hal.errors import HardwareError
from rtstack.cells import load_description
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable, running_stacks
from rtstack.live.protocol import Phase
from rtstack.samples import SIDES
from rtstack.trials.errors import TrialError

USER, PASSWORD = "RTSTACK_DESK_USER", "RTSTACK_DESK_PASSWORD"
_AT_REST = (Phase.DISARMED, Phase.FAULT)


def status(left: str | None, right: str | None, cell_file: Path | None, as_json: bool) -> None:
    """Print the state of both. Raises TrialError, HardwareError with one line."""
    addresses, trust = _addresses(left, right, cell_file), Trust()
    _meet(addresses, trust)
    states: list[DeskState] = []
    for side, address in zip(SIDES, addresses, strict=True):
        with closing(Desk(address, trust, _sign_in(ask=False), f"{side} box")) as desk:
            states.append(desk.state())
    if as_json:
        both = zip(SIDES, states, strict=True)
        typer.echo(json.dumps({side: {**asdict(state), "ready": state.ready} for side, state in both}))
        return
    for side, address, state in zip(SIDES, addresses, states, strict=True):
        due = "" if state.self_test_s is None else f", due in {state.self_test_s / 3600.0:.1f} h"
        typer.echo(
            f"{side} box, {address}: {'ready' if state.ready else 'not ready'}: brakes {state.brakes}, "
            f"FCI {state.fci}, mode {state.operating_mode}, control {state.control or 'free'}, "
            f"self-test {state.self_test}{due}, system {state.version}, serial {state.serial}"
        )
        for line in (*state.obstacles, *filter(None, [state.warning])):
            typer.echo(f"{side} box: {line}")


def start(left: str | None, right: str | None, cell_file: Path | None, self_test: bool) -> None:
    """Let FCI in at both. Raises TrialError, HardwareError with one line of both boxes."""
    addresses = _addresses(left, right, cell_file)
    if self_test:
        _refuse_in_use(addresses, cell_file)
    _both(addresses, lambda desk, trust, address: start_box(desk, trust, address, self_test))


def stop(left: str | None, right: str | None, cell_file: Path | None, shut_down: bool) -> None:
    """End FCI at both, and shut them down where that is asked for. Raises TrialError, HardwareError."""
    addresses = _addresses(left, right, cell_file)
    _refuse_in_use(addresses, cell_file)
    _both(addresses, lambda desk, trust, address: stop_box(desk, trust, address, shut_down))


def _addresses(left: str | None, right: str | None, cell_file: Path | None) -> tuple[str, str]:
    description, source = load_description(cell_file)
    found = left or description.left.desk, right or description.right.desk
    if not all(found):
        raise TrialError(
            "where is Desk of the boxes? Give --left and --right HOST[:PORT], or --cell-file with "
            f'desk = "HOST" under [left] and [right] ({source} has none)'
        )
    if found[0] == found[1]:
        raise TrialError(f"two boxes have two addresses: Desk of both would be at {found[0]}")
    return found


def _both(addresses: tuple[str, str], steps: Callable[[Desk, Trust, str], Iterator[str]]) -> None:
    trust = Trust()
    _meet(addresses, trust)
    sign_in = _sign_in(ask=True)

    def run(side: str, address: str) -> str:
        try:
            with closing(Desk(address, trust, sign_in, f"{side} box")) as desk:
                for line in steps(desk, trust, address):
                    typer.echo(f"{side} box: {line}")
        except (HardwareError, OSError) as error:
            return str(error)
        return ""

    with ThreadPoolExecutor(2) as pool:
        refusals = [line for line in pool.map(run, SIDES, addresses) if line]
    if refusals:
        raise HardwareError("; ".join(refusals))


def _meet(addresses: tuple[str, str], trust: Trust) -> None:
    """Remember the certificates of boxes that this user has not used before, and say so."""
    for side, address in zip(SIDES, addresses, strict=True):
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


def _refuse_in_use(addresses: tuple[str, str], cell_file: Path | None) -> None:
    """Raise TrialError where a stack on this machine may move these arms."""
    description, _ = load_description(cell_file)
    arms = {address.partition(":")[0] for address in addresses}
    if cell_file is not None:
        arms |= {description.left.address, description.right.address}
    for socket in running_stacks():
        client = RobotClient(socket)
        try:
            state = client.status()
        except (RobotRefused, RobotUnreachable):
            continue
        finally:
            client.close()
        used = set(state.cell.partition(":")[2].split(","))
        if used & arms and state.phase not in _AT_REST:
            raise TrialError(f"a stack has these arms and is {state.phase} ({socket}): disarm it first")
