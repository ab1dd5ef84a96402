"""The command line's parser: a table of commands, each loaded from its module when it is invoked."""

import errno
import os
import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.completion import completion_init  # pyright: ignore[reportPrivateImportUsage]
from typer.core import TyperGroup
from typer.main import get_command, get_group

from rtstack.cli.completion import VARIABLE
from rtstack.cli.exit_status import BAD_INPUT, FAILED

_STYLE: dict[str, Any] = {"add_completion": False, "pretty_exceptions_enable": False, "rich_markup_mode": None}
# in the order of `rtstack --help`: the command's module in this package, and how its help begins, for the list
COMMANDS = {
    "demo": ("trials", "The whole way once, simulated: a demonstration, a trial of it with the object displaced."),
    "teach": ("trials", "Record a scripted demonstration through the teleoperation path."),
    "trial": ("trials", "Run one trial: follow a recording through the impact."),
    "play": ("trials", "Play a log on the arms themselves, with a soft start and a soft stop."),
    "place": ("place", "Let both arms take an object from where the tracker sees it, and set it down."),
    "excite": ("friction", "Move all joints of both arms at once, in free space: what `rtstack twin` needs."),
    "identify-friction": ("friction", "Move one joint after the other, with the object out of the way."),
    "guide": ("calibrate", "Let a person move both arms by hand, also back from beyond a limit."),
    "wiggle": ("calibrate", "Turn one joint of an arm by a degree and back, so that a person sees which one it is."),
    "calibrate": ("calibrate", "Find bases, tracker, pads and payloads from points that the pads touch."),
    "commission": ("commission", "Show which steps of commissioning are signed, and which one is next."),
    "review": ("review", "Say what is in a log: result, events, impacts, recomputed from its samples."),
    "replay": ("replay", "Give a log's states to the present controller: does it make the same of them?"),
    "plot": ("plot", "Draw curves of a log, or of up to five above each other; without signals the pads' forces."),
    "export": ("export", "Make a data set of logs, for learning code."),
    "import": ("export", "Make a log of an episode, to be played on the arms (`rtstack play`)."),
    "recover": ("recovery", "Make a complete log of one that was cut off or damaged."),
    "recover-arms": ("recovery", "Clear what the arms have latched (a fault, a reflex), once its cause is gone."),
    "up": ("stack", "Start the whole stack, with the arms at --left and --right or the simulated cell."),
    "robot": ("stack", "Run the robot process alone, as a service does: cell, loop and logs."),
    "console": ("stack", "Run the console alone, beside `rtstack robot`, with the same options."),
    "teleoperate": ("teleoperate", "Take control, arm, and let an input device lead the arms of a running stack."),
    "policy": ("policy", "Let a policy lead the arms, as an operator would: at a console once it has a lease."),
    "sim": ("simulator", "Serve the simulated arms at their addresses, as robots would be, until Ctrl-C."),
    "check": ("check", "Say what this machine lacks, and what that costs; with their addresses hold the arms."),
    "host-setup": ("host_setup", "Set this PC up for the arms: limits, CPU isolation, governor, network; as root."),
    "campaign": ("campaign", "Run many trials and write what they show: figures, tables, and each claim."),
    "campaign compare": ("campaign", "Say what differs between two campaigns of one plan: each column, each claim."),
    "campaign pack": ("campaign", "Make a campaign's folder a data set to publish: columns, units, checksums."),
    "tune-monitor": ("monitor", "Find the aim-aware monitor's parameters from good runs of one object."),
    "impact-map": ("impact_map", "Say what velocity follows an impact: single step and converged, with impulses."),
    "twin": ("twin", "Identify both arms from their logs: a profile of the simulated robot, a friction."),
    "home": ("home", "Find where a trial starts: pads flat, clear of limits, table and other arm; or say why not."),
    "plan": ("plan", "Plan a reference without a demonstration: paths before and after the impact."),
    "completion": ("completion", "Print the script with which a shell completes commands, options and files."),
    "bench": ("bench", "Measure the stack on this machine."),
    "desk": ("desk", "Desk of both control boxes: brakes, FCI, self-test, shutting down."),
    "token": ("token", "Let programs use the console (bearer tokens), and a browser back in (sign-in)."),
    "logs": ("log_folder", "List, compare and prune the logs of a folder."),
}


# A disk or folder that does not take a file. Any other error of a system call is a defect of this program.
_HOST = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOENT)


class LazyGroup(TyperGroup):
    """Lists the table without an import, and loads the command that is invoked."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the name of the command, one word or two, the command from its module, and its arguments."""
        if (both := " ".join(args[:2])) in COMMANDS:
            args = [both, *args[2:]]
        name, _, rest = super().resolve_command(ctx, args)
        return name, None if name is None else load(name), rest


app = typer.Typer(cls=LazyGroup, **_STYLE)
for _command, (_, _beginning) in COMMANDS.items():
    app.command(_command, help=_beginning)(lambda: None)


def load(name: str) -> Any:
    """Return a command of the table, or group of commands, from its module."""
    part = typer.Typer(**_STYLE)
    part.add_typer(import_module(f"rtstack.cli.{COMMANDS[name][0]}").commands)
    return get_group(part).commands[name]


def whole() -> Any:
    """Return the command line with every command loaded, for what walks over all of them."""
    root = get_command(app)
    root.commands = {name: load(name) for name in COMMANDS}  # type: ignore[attr-defined]
    return root


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
    if VARIABLE in os.environ:
        completion_init()  # a shell asks for completions: typer answers them
    arguments = sys.argv[1:] or ["--help"]
    try:
        status = app(arguments, prog_name="rtstack", standalone_mode=False)
    except Exception as error:
        status = _explain(error)
    sys.exit(status if isinstance(status, int) else 0)


def _explain(error: Exception) -> int:
    """Print the one line that an error deserves, and return the exit status."""
    from pydantic import ValidationError

    from hal.base.configuration import ConfigurationError
    from hal.base.extras import advice
    from hal.errors import HardwareError
    from hal.extensions import ExtensionError, culprit, raised
    from rtstack.log.errors import LogError
    from rtstack.messages import problem
    from rtstack.trials.errors import TrialError

    usage = getattr(error, "format_message", None)  # what typer raises for a wrong option or argument
    if usage is not None:
        return _say(f"{usage()} (see --help)", BAD_INPUT)
    if isinstance(error, ModuleNotFoundError) and (lacking := advice(error.name)):
        return _say(lacking, BAD_INPUT)
    # proxsuite and Pinocchio link it, and a bare system may have none
    if isinstance(error, ImportError) and "libgomp.so.1" in str(error):
        return _say("the system's package of libgomp.so.1 is missing: apt-get install libgomp1", BAD_INPUT)
    if isinstance(error, ValidationError):
        return _say(problem(error), BAD_INPUT)
    if os.environ.get("RTSTACK_TRACEBACK") and error.__cause__ is not None and culprit(error.__cause__):
        raise error
    if isinstance(error, TrialError | LogError | ConfigurationError | HardwareError | ExtensionError):
        return _say(str(error), BAD_INPUT)
    if isinstance(error, OSError) and error.errno in _HOST:
        what = f"{error.filename or 'a file'}: {error.strerror}"
        return _say(f"{what}: make room there, or choose another place", BAD_INPUT)
    if os.environ.get("RTSTACK_TRACEBACK"):
        raise error
    if culprit(error):
        return _say(f"{raised(error)}; set RTSTACK_TRACEBACK=1 to see how it came to that", FAILED)
    return _say(f"internal error: {raised(error)}; set RTSTACK_TRACEBACK=1 to see where, and report it", FAILED)


def _say(message: str, status: int) -> int:
    print("rtstack: " + " ".join(message.split()), file=sys.stderr)
    return status
