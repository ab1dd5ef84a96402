"""The command line as a child of another program: it never outlives its parent, and leaves the processor to others.

    python -m rtstack.cli.child NICENESS campaign NAME --out DIR ...

Its standard input is a pipe that the parent holds: once that is gone, the command ends as at Ctrl-C.
"""

import os
import signal
import sys

from rtstack.live.parent_watch import watch_parent


def main() -> None:
    """Run the command line at this niceness."""
    os.nice(int(sys.argv[1]))
    # the thread that waits keeps Ctrl-C blocked: it is the main thread's, which blocks it while workers start
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    watch_parent(lambda: os.kill(os.getpid(), signal.SIGINT))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    from rtstack.cli import main as command_line

    sys.argv[:] = ["rtstack", *sys.argv[2:]]
    command_line()


if __name__ == "__main__":
    main()
