"""The simulated cell: one arm or two with flexible joints, an object, what they report, and what they refuse.

Scene and plant parameters are files; the controller never reads either of them. The plant, the sensors, the
reflexes and the cell do no I/O, so that the same plant can be stepped in one process or served over the
network.
"""
