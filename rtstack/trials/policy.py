"""Runs a policy on a cell that waits, in this process: a teleoperation that a policy leads from its beginning."""

import os
from itertools import count

from hal.cell import Cell
from rtstack.loop.mailbox import Mailbox
from rtstack.model.cell_description import CellDescription
from rtstack.teleoperation.policy import Policy
from rtstack.trials.errors import TrialError
from rtstack.trials.policy_host import PolicyHost
from rtstack.trials.result import TeleoperationResult
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.specification import TeleoperationSpecification
from rtstack.trials.teleoperation import run_teleoperation

RATE_HZ = 20.0
LONGEST_S = 60.0
_NUMBERS = count()


def run_policy(
    policy: Policy, specification: TeleoperationSpecification, description: CellDescription, cell: Cell,
    context: RunContext = NO_CONTEXT, *, rate_hz: float = RATE_HZ, longest_s: float = LONGEST_S, delay_s: float = 0.0,
) -> TeleoperationResult:  # fmt: skip
    """Let a policy lead the arms of an open cell until it has finished; see PolicyHost. Closes the log, not the cell.

    Raises TrialError for a cell that does not wait: there `rtstack policy --console` lets a policy lead.
    """
    if cell.own_clocks:
        raise TrialError(f"the cell {cell.name} does not wait for a policy: start rtstack up, and give --console")
    mailbox = Mailbox.create(f"rtstack-policy-{os.getpid()}-{next(_NUMBERS)}")
    try:
        host = PolicyHost(policy, mailbox, specification.job, rate_hz, longest_s, delay_s)
        return run_teleoperation(specification, description, cell, mailbox, context, clock=host.clock, host=host)
    finally:
        mailbox.close()
