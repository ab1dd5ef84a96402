"""Measurements of the stack on this machine: ratios to something in the same run, never a bare time."""
