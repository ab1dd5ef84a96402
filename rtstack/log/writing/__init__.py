"""Writes a log: a process of its own, fed through rings."""
