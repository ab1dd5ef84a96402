"""Desk of a served simulated robot, as a user of this machine reaches it."""

from hal.desk import Desk, SignIn, Trust
from sim_robot.desk.process import PORT
from sim_robot.desk.server import PASSWORD, USER

SIGN_IN = SignIn(USER, PASSWORD)


def desk_address(address: str) -> str:
    """Return where Desk of the simulated box is whose arm is at this address."""
    return f"{address}:{PORT}"


def desk_of(address: str, trust: Trust, sign_in: SignIn | None = SIGN_IN) -> Desk:
    """Return a client of that Desk, which trust knows from now on."""
    trust.remember(desk_address(address))
    return Desk(desk_address(address), trust, sign_in)
