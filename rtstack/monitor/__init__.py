"""Aim-aware monitoring: was an impact the one that was meant? Pure: no I/O, no clock, any number of joints."""
