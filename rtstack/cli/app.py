"""The command line's parser, put together in the order of `rtstack --help`."""

import os
import sys

import typer

from rtstack.cli.commands import bench, host, logs, plan, retention, runs, stack, studies, token

BAD_INPUT = 2
FAILED = 1

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Impact-aware dual-arm control: demonstrate, run, review.",
)
for part in (runs, logs, stack, host, studies, plan):
    app.add_typer(part.commands)
app.add_typer(bench.commands, name="bench")
app.add_typer(token.commands, name="token")
app.add_typer(retention.commands, name="logs")


def main() -> None:
    """Run the command line. Bad input is one line on stderr and exit status 2; no traceback reaches a user."""
    arguments = sys.argv[1:] or ["--help"]
    try:
        status = app(arguments, prog_name="rtstack", standalone_mode=False)
    except Exception as error:
        status = _explain(error)
    sys.exit(status if isinstance(status, int) else 0)


def _explain(error: Exception) -> int:
    """Print the one line that an error deserves, and return the exit status."""
    from hal.configuration import ConfigurationError
    from hal.errors import HardwareError
    from hal.extensions import ExtensionError
    from rtstack.log.errors import LogError
    from rtstack.trials.errors import TrialError

    usage = getattr(error, "format_message", None)  # what typer raises for a wrong option or argument
    if usage is not None:
        return _say(f"{usage()} (see --help)", BAD_INPUT)
    if isinstance(error, TrialError | LogError | ConfigurationError | HardwareError | ExtensionError):
        return _say(str(error), BAD_INPUT)
    if os.environ.get("RTSTACK_TRACEBACK"):
        raise error
    return _say(
        f"internal error: {type(error).__name__}: {error}; set RTSTACK_TRACEBACK=1 to see where, and report it", FAILED
    )


def _say(message: str, status: int) -> int:
    print("rtstack: " + " ".join(message.split()), file=sys.stderr)
    return status
