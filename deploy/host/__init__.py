"""Sets a PC up for two real arms: a plan of changes, shown or applied, and taken back to the byte.

machine -> plan -> journal. Standard library only, and none of our packages.
"""

from deploy.host.changes import Change, Command, File, Knob
from deploy.host.journal import Journal
from deploy.host.machine import HostSetupError, Machine
from deploy.host.plan import Interface, SetupPlan, Wishes, make_plan

__all__ = [
    "Change",
    "Command",
    "File",
    "HostSetupError",
    "Interface",
    "Journal",
    "Knob",
    "Machine",
    "SetupPlan",
    "Wishes",
    "make_plan",
]
