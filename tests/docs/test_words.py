"""The documentation names what exists, and texts name the operator, the process or the condition that they mean."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# a pronoun for a person does not say which operator, program or condition is meant
_VAGUE = re.compile(r"\b(nobody|somebody|whoever|anybody)\b", re.IGNORECASE)
_TEXTS = (".py", ".md", ".js", ".html", ".toml", ".service")
_PATH = re.compile(r"`((?:rtstack|hal|sim_robot|console|deploy|docs|tests|examples)/[\w./{},-]*)`")


def _files() -> list[Path]:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in listed.splitlines()]


def _expanded(path: str) -> list[str]:
    """Return the paths of one with alternatives in braces."""
    found = re.fullmatch(r"(.*)\{(.*)\}(.*)", path)
    return [path] if found is None else [found[1] + one + found[3] for one in found[2].split(",")]


def test_every_path_that_the_architecture_and_the_decisions_name_exists():
    pages = [ROOT / "ARCHITECTURE.md", *sorted((ROOT / "docs/decisions").glob("*.md"))]
    named = [(page.name, path) for page in pages for one in _PATH.findall(page.read_text()) for path in _expanded(one)]
    assert len(named) > 40
    assert [(page, path) for page, path in named if not (ROOT / path).exists()] == []


def test_the_architecture_is_one_page():
    assert len((ROOT / "ARCHITECTURE.md").read_text().splitlines()) <= 72


def test_the_decisions_are_numbered_without_gaps():
    pages = sorted((ROOT / "docs/decisions").glob("[0-9]*.md"))
    for number, page in enumerate(pages, 1):
        text = page.read_text()
        assert page.name.startswith(f"{number:03}-")
        assert text.startswith(f"# {number}. ")
        assert all(f"**{part}.**" in text for part in ("Context", "Decision", "Consequence")), page.name


def test_texts_say_who_or_what_they_mean():
    product = ("rtstack", "hal", "sim_robot", "console", "deploy", "docs", "examples")
    texts = [
        path
        for path in _files()
        if path.suffix in _TEXTS and path.exists() and path.name != "CHANGELOG.md"
        if path.relative_to(ROOT).parts[0] in product or path.parent == ROOT
    ]
    assert len(texts) > 500
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in texts
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if _VAGUE.search(line)
    ]
    assert found == []
