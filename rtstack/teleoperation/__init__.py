"""Teleoperation in the loop: the requested poses, their filter, and the stop when the clutch is not held."""
