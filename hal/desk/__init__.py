"""Desk, the vendor's page of a control box: what it shows, and the few things that a program has to do there.

The interface is that of Desk's API version 1 (system 5 and newer) as published clients show it, without a real box:
franky 2.0 (franky.Desk), franka-desk 0.1 and franka-deskapi 1.0. What is missing in an answer is "unknown".
"""

from hal.desk.client import Desk, DeskError, NotTrusted, SignIn, Trust
from hal.desk.state import DeskState

__all__ = ["Desk", "DeskError", "DeskState", "NotTrusted", "SignIn", "Trust"]
