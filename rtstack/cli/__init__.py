"""The command line, and the only place that puts a stack together from its parts."""

from rtstack.cli.app import main

__all__ = ["main"]
