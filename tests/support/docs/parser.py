"""Whether a command that is not run exists: its words against our own parser, the Makefile and the repository."""

import importlib.util
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rtstack.cli.app import whole
from tests.support.docs.blocks import ROOT, Block

_SEPARATORS = {";", "&&", "||", "|", "(", ")", "&", "\n"}
_PREFIXES = {"do", "then", "else", "exec", "sudo"}
_VARIABLE = re.compile(r"\$\{?\w+\}?")
_TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def commands_of(block: Block) -> Iterator[list[str]]:
    """Yield the words of each simple command of a block."""
    text = block.text.replace("\\\n", " ")
    if block.language == "console":
        text = "\n".join(line[2:] for line in text.splitlines() if line.startswith("$ "))
    for line in text.splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        words: list[str] = []
        for word in [*lexer, "\n"]:
            if word not in _SEPARATORS:
                words.append(word)
                continue
            while words and (words[0] in _PREFIXES or "=" in words[0]):
                words.pop(0)
            if words:
                yield words
            words = []


def problem_of(words: list[str]) -> str | None:
    """Return why a command cannot be right, None where nothing is known against it."""
    for cut in (">", ">>", "<"):
        words = words[: words.index(cut)] if cut in words else words
    program, arguments = Path(words[0]).name, words[1:]
    if program == "rtstack":
        return _parsed([_VARIABLE.sub("1", word) for word in arguments])
    if program == "make":
        unknown = [word for word in arguments if "=" not in word and word not in _TARGETS]
        return f"the Makefile has no target {unknown[0]}" if unknown else None
    if program in ("python", "python3") and arguments[:1] == ["-m"]:
        return None if importlib.util.find_spec(arguments[1]) else f"there is no module {arguments[1]}"
    candidates = arguments[:1] if program in ("python", "python3", "bash", "sh") else [words[0]]
    for name in candidates:
        ours = name.removeprefix("./")
        if ours.partition("/")[0] in ("deploy", "tests", "examples", "docs") and not (ROOT / ours).exists():
            return f"there is no file {ours}"
    return None


def unknown_word(command: str) -> str | None:
    """Return the sub-command or option of ours that a command names and that does not exist, None where all do."""
    found, name, words = _command(shlex.split(command)[1:])
    if found is None:
        return name
    known = {option for parameter in found.params for option in parameter.opts} | {"--help"}
    return next((word for word in words if word.startswith("--") and word.partition("=")[0] not in known), None)


def _command(words: list[str]) -> tuple[Any, str, list[str]]:
    """Return the command that words begin with, its name of one word or two, and what follows; None for no such one."""
    found: Any = whole()
    name = "rtstack"
    while hasattr(found, "commands") and words and not words[0].startswith("-"):
        count = 2 if " ".join(words[:2]) in found.commands else 1
        name, words = " ".join(words[:count]), words[count:]
        if name not in found.commands:
            return None, name, words
        found = found.commands[name]
    return found, name, words


def _parsed(arguments: list[str]) -> str | None:
    command, name, arguments = _command(arguments)
    if command is None:
        return f"rtstack has no command {name}"
    if "--help" in arguments or (name == "rtstack" and not arguments):
        return None
    try:
        command.make_context(name, arguments)
    except Exception as error:  # the parser's, which has no public base
        said = getattr(error, "format_message", None)
        return repr(error) if said is None else said()
    return None
