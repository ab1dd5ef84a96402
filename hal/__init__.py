"""The hardware contract: what an arm is (state in, torque out, 1 kHz), its limits, its errors, the tracker.

Nothing here differs between a simulated and a real robot: an arm is an address. Imports none of our packages.
"""
