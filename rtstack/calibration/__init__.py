"""Bases, pads, tracker and what the arms carry, by least squares from measured points."""
