"""What is started by hand, from the clone: `make program NAME=...`, or `python -m tests.programs.NAME`.

A program is a module with a function whose signature is its command line, and `program(function)` at its end. The first
line of the module's docstring says what it shows, the last one how long it takes: `make program` lists both.
"""

import inspect
import os
import sys
from collections.abc import Callable, Collection, Iterable
from functools import wraps
from signal import SIGINT, SIGTERM, default_int_handler, signal
from typing import Annotated, Any, get_type_hints

import typer

from hal.base.configuration import ConfigurationError
from hal.errors import HardwareError
from hal.extensions import ExtensionError
from rtstack.log.errors import LogError
from rtstack.trials.errors import TrialError
from tests.support.network.namespaces import NotPermitted

FAILED, BAD_INPUT, NOT_PERMITTED, INTERRUPTED = 1, 2, 3, 130
REFUSALS = (ConfigurationError, HardwareError, ExtensionError, LogError, TrialError)


def program(function: Callable[..., int | None], arguments: list[str] | None = None) -> None:
    """Run a program, and exit with the status that its function returns.

    Ctrl-C and SIGTERM end it with 130 and no traceback, bad input with 2; each prints one line. A parameter with a
    default is an option (--NAME, with hyphens; a flag where it is False), one without is an argument; a list is an
    option that may be given again.

    Args:
        function: Keywords and defaults become options; `Annotated[..., typer.Option(...)]` says more about one.
        arguments: The command line, without the program's name; by default that of the process.
    """
    module = sys.modules[function.__module__]
    name = module.__spec__.name.removesuffix(".__main__") if module.__spec__ else module.__name__
    hints = get_type_hints(function, include_extras=True)
    for key, parameter in inspect.signature(function).parameters.items():
        if hints[key] is bool and parameter.default is False:  # without --no-...
            function.__annotations__[key] = Annotated[bool, typer.Option(f"--{key.replace('_', '-')}")]
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    first = os.getpid()

    @wraps(function)
    def run(*values: Any, **options: Any) -> int | None:
        try:
            return function(*values, **options)
        except KeyboardInterrupt:  # typer would add a line of its own
            if os.getpid() != first:  # a process that the program has forked
                os._exit(INTERRUPTED)
            raise typer.Exit(INTERRUPTED) from None

    app.command(help=module.__doc__)(run)
    for number in (SIGINT, SIGTERM):  # a script in the background ignores the first
        signal(number, default_int_handler)
    try:
        status = app(arguments, prog_name=f"python -m {name}", standalone_mode=False)
    except REFUSALS as error:
        status = _say(name, str(error), BAD_INPUT)
    except NotPermitted as error:
        status = _say(name, f"no network namespaces here: {error}", NOT_PERMITTED)
    except Exception as error:
        if (usage := getattr(error, "format_message", None)) is None:
            raise
        status = _say(name, f"{usage()} (see --help)", BAD_INPUT)
    if status == INTERRUPTED:
        _say(name, "ended; where it keeps results, the same command goes on", INTERRUPTED)
    sys.exit(status if isinstance(status, int) else 0)


def choose(given: Iterable[str] | None, names: Collection[str]) -> list[str]:
    """Return what was given, or all names. Raises typer.BadParameter for one that is none of them."""
    chosen = list(given or names)
    for name in chosen:
        if name not in names:
            raise typer.BadParameter(f"there is no {name!r}: choose from {', '.join(names)}")
    return chosen


def hidden(kind: Any, *names: str) -> Any:
    """Return the type of a parameter with which a program starts itself again, for a part: --help leaves it out."""
    return Annotated[kind, typer.Option(*names, hidden=True)]


def _say(name: str, text: str, status: int) -> int:
    print(f"{name.rpartition('.')[2]}: {text}", file=sys.stderr)
    return status
