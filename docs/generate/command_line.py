"""The command line reference, from the parser itself."""

from typing import Any

import typer

from rtstack.cli.app import whole

PROGRAM = "rtstack"


def commands() -> dict[str, Any]:
    """Return every command by what one types, such as `rtstack bench tick`, in the order of `rtstack --help`."""
    found: dict[str, Any] = {}

    def walk(command: Any, words: str) -> None:
        for name, child in getattr(command, "commands", {}).items():
            walk(child, f"{words} {name}")
        if not hasattr(command, "commands"):
            found[words] = command

    walk(whole(), PROGRAM)
    return found


def command_line_page() -> str:
    """Return the page, in Markdown."""
    parts = [
        "# Command line\n\nEvery command and option, from the parser. `make setup` puts `rtstack` in `.venv/bin`.\n\n"
        "Exit status 0: it did what was asked. 1: the trial or check failed. 2: bad input, with one line on stderr "
        "that says what to do, and nothing written. `--json` prints one JSON object, alone, on stdout. The same "
        "command and seed give the same log, bit for bit, in the direct and in the lockstep cell.\n"
    ]
    for words, command in commands().items():
        context = typer.Context(command, info_name=words)
        usage = " ".join(command.collect_usage_pieces(context))
        parts.append(f"## {words}\n\n{command.help}\n\n```text\n{words} {usage}\n```\n")
        rows = [_row(parameter, context) for parameter in command.params if not getattr(parameter, "hidden", False)]
        parts.append("\n".join(["| option | what |", "|---|---|", *rows]) + "\n")
    return "\n".join(parts)


def _row(parameter: Any, context: Any) -> str:
    written, meaning = parameter.get_help_record(context) or (parameter.metavar or parameter.name, parameter.help)
    cells = (f"`{written.strip()}`", (meaning or "").strip())
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
