"""Scripted faults: `kinds` lists what can go wrong, `file` reads a script, `injection` and `link` carry it out."""
