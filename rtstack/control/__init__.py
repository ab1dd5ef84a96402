"""The tick: from the state of an arm and its reference to a torque, without I/O, clock or allocation.

Read in the order of the data: setpoint (what is wanted), impedance (the task), law (limits and torque), program (the
QP); beside them observer and detector (what happened) and modes (which reference counts now). `tick` joins them.
"""
