"""The command line's parser, put together in the order of `rtstack --help`."""

import os
import sys
from typing import Annotated

import typer
from typer.completion import completion_init  # pyright: ignore[reportPrivateImportUsage]

from rtstack.cli.commands import bench, desk, host, log_folder, logs, plan, runs, shell, stack, studies, token

BAD_INPUT = 2
FAILED = 1

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for part in (runs, logs, stack, host, studies, plan, shell):
    app.add_typer(part.commands)
app.add_typer(bench.commands, name="bench")
app.add_typer(desk.commands, name="desk")
app.add_typer(token.commands, name="token")
app.add_typer(log_folder.commands, name="logs")


def _version(asked: bool) -> None:
    if asked:
        import platform
        from importlib.metadata import version

        typer.echo(f"rtstack {version('rtstack')}, Python {platform.python_version()}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which version this is.")
    ] = False,
) -> None:
    """Impact-aware dual-arm control: demonstrate, run, review."""


def main() -> None:
    """Run the command line. Bad input is one line on stderr and exit status 2; no traceback reaches a user."""
    if shell.VARIABLE in os.environ:
        completion_init()  # a shell asks for completions: typer answers them
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
    from hal.extras import advice
    from rtstack.log.errors import LogError
    from rtstack.trials.errors import TrialError

    usage = getattr(error, "format_message", None)  # what typer raises for a wrong option or argument
    if usage is not None:
        return _say(f"{usage()} (see --help)", BAD_INPUT)
    if isinstance(error, ModuleNotFoundError) and (lacking := advice(error.name)):
        return _say(lacking, BAD_INPUT)
    # proxsuite and Pinocchio link it, and a bare system may have none
    if isinstance(error, ImportError) and "libgomp.so.1" in str(error):
        return _say("the system's package of libgomp.so.1 is missing: apt-get install libgomp1", BAD_INPUT)
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
