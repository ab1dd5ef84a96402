"""The command line, and the only place that puts a stack together from its parts."""

import signal


def main() -> None:
    """Run the command line."""
    # until a run asks for a controlled stop, Ctrl-C simply ends the program: no traceback, also while it still imports
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from rtstack.cli.app import main as run

    run()
