"""The fenced blocks of the documentation: what each is, and whether a machine without a robot runs it."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[3]
RUNBOOK = ROOT / "docs/runbook"
PAGES = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
PAGES += sorted((ROOT / "docs").rglob("*.md"))


class Use(Enum):
    """What is done with a block."""

    RUN = auto()
    SLOW = auto()  # the program `deeper` with docs-commands runs it
    BACKGROUND = auto()  # runs until the page's end
    FILE = auto()  # written under its title
    CHECKED = auto()  # of commands, only that they exist
    SHOWN = auto()  # nothing to run


LANGUAGES = ("bash", "console", "python", "toml", "text")
_TITLES = {
    "": Use.RUN,
    "takes minutes": Use.SLOW,
    "in a terminal of its own": Use.BACKGROUND,
    "from a clone": Use.CHECKED,
    "on a desktop": Use.CHECKED,
    "on the robot's PC": Use.CHECKED,
    "on several machines": Use.CHECKED,
    "in real time": Use.CHECKED,
    "while rtstack up runs": Use.CHECKED,
}
_TITLE = re.compile(r'title="([^"]*)"')
_FILE = re.compile(r"[\w-]+\.\w+")


@dataclass(frozen=True, slots=True)
class Block:
    """A block: its page, the line of its fence, language, title, and what is in it."""

    page: Path
    line: int
    language: str
    title: str
    text: str
    use: Use

    @property
    def place(self) -> str:
        """Return where it is, for a message."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks_of(page: Path) -> Iterator[Block]:
    """Yield a page's blocks. Raises ValueError for one that no test would see: no language, an unknown title."""
    for token in MarkdownIt().parse(page.read_text()):
        if token.type not in ("fence", "code_block"):
            continue
        line = (token.map or [0])[0] + 1
        language, _, rest = token.info.strip().partition(" ")
        place = f"{page.relative_to(ROOT)}:{line}"
        if page.is_relative_to(RUNBOOK) and not language:
            yield Block(page, line, "bash", "", token.content, Use.CHECKED)
            continue
        if token.type == "code_block" or language not in LANGUAGES:
            raise ValueError(f"{place}: a block needs a fence and one of the languages {', '.join(LANGUAGES)}")
        found = _TITLE.search(rest)
        title = found[1] if found else ""
        yield Block(page, line, language, title, token.content, _use(page, place, language, title))


def inline_commands(page: Path) -> Iterator[str]:
    """Yield the commands of ours that a page names within its text; what `rtstack up` says is none."""
    for token in MarkdownIt("commonmark").enable("table").parse(page.read_text()):
        for child in token.children or ():
            if child.type == "code_inline" and re.match(r"rtstack (?!is up)", child.content):
                yield " ".join(child.content.split())


def _use(page: Path, place: str, language: str, title: str) -> Use:
    if title and _FILE.fullmatch(title):
        return Use.FILE
    if language in ("text", "toml"):
        return Use.SHOWN
    if page.is_relative_to(RUNBOOK):
        return Use.CHECKED  # about metal, as a whole
    if title not in _TITLES:
        raise ValueError(f'{place}: title="{title}" says not whether the block can be run: {", ".join(_TITLES)}')
    return _TITLES[title]
