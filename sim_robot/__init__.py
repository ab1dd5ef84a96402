"""The simulated cell: one arm or two with flexible joints, an object, what they report, and what they refuse.

Scene and plant parameters are files that the controller never reads. Only `fci` and `desk` do I/O.
"""
