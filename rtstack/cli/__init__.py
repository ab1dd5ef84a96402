"""The command line, and the only place that puts a stack together from its parts."""

import signal
import sys

from rtstack import refuse_shadows


def main() -> None:
    """Run the command line."""
    # until a run asks for a controlled stop, Ctrl-C simply ends the program: no traceback, also while it still imports
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        refuse_shadows("sim_robot", "console", "deploy")
    except ImportError as error:
        sys.stderr.write(f"rtstack: {error}\n")
        raise SystemExit(2) from None
    from rtstack.cli.app import main as run

    run()
