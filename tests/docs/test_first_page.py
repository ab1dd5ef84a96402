"""What newcomers ask is answered within two clicks of README, which is one page and the site's first one."""

import re
import sys
from pathlib import Path

import pytest
from markdown.extensions.toc import slugify
from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
sys.path.insert(0, str(ROOT / "docs/generate"))

from example_pages import EXAMPLES, title_of  # noqa: E402

QUESTIONS = {
    "Where do I start with one FR3?": ("faq.md#where-do-i-start-with-one-fr3", "howto/one_arm.md#a-cell-of-one-arm"),
    "Does it run on a Panda (FER)?": (
        "faq.md#does-it-run-on-a-panda-fer",
        "howto/protocol.md#older-firmware-and-pandas",
    ),
    "What do I need?": ("faq.md#what-do-i-need", "reference/compatibility.md#compatibility"),
    "Can I use the simulator with my own libfranka client?": (
        "faq.md#can-i-use-the-simulator-with-my-own-libfranka-client",
        "reference/compatibility.md#clients-of-the-simulated-robot",
    ),
    "How do I cite it?": ("faq.md#how-do-i-cite-it", "cite.md#how-to-cite"),
    "What was reproduced?": ("faq.md#what-was-reproduced", "reproduced.md#reproduced"),
    "Is it safe to run on a real arm?": ("faq.md#is-it-safe-to-run-on-a-real-arm", "reference/hazards.md#hazards"),
    "Does it need ROS, or a real-time kernel?": ("faq.md#does-it-need-ros-or-a-real-time-kernel",),
    "Which Python?": ("faq.md#which-python", "reference/compatibility.md#versions-of-python"),
    "How do I write a controller?": (
        "faq.md#how-do-i-write-a-controller",
        "howto/notebook.md#a-controller-of-your-own",
    ),
    "Where are the logs, and how do I read them?": (
        "faq.md#where-are-the-logs-and-how-do-i-read-them",
        "examples.md#02-read-a-log",
    ),
    "What if the robot stops with an error?": (
        "faq.md#what-if-the-robot-stops-with-an-error",
        "runbook/recovery.md#what-the-robot-says",
    ),
}


def _links(page: Path) -> set[Path]:
    """Return the pages of this repository that a page links to."""
    found = set()
    for token in MarkdownIt("commonmark").enable("table").parse(page.read_text()):
        for child in token.children or ():
            target = str(child.attrs.get("href", "")).partition("#")[0] if child.type == "link_open" else ""
            if target.endswith(".md") and "://" not in target:
                found.add((page.parent / target).resolve())
    return found


def _headings(page: Path) -> list[str]:
    tokens = MarkdownIt("commonmark").parse(page.read_text())
    return [tokens[k + 1].content.replace("`", "") for k, token in enumerate(tokens) if token.type == "heading_open"]


def _anchors(page: Path) -> set[str]:
    headings = _headings(page)
    if page.name == "examples.md":  # the site's hook adds a section for each
        headings += [title_of(path) for path in EXAMPLES]
    return {slugify(heading, "-") for heading in headings}


@pytest.fixture(scope="module")
def reachable() -> set[Path]:
    """The pages that README links to, and those that they link to."""
    once = _links(README)
    return once.union(*(_links(page) for page in once if page.exists()))


def test_every_link_leads_to_a_page():
    for page in (README, ROOT / "docs/index.md", ROOT / "docs/faq.md", ROOT / "docs/examples.md"):
        missing = [str(target) for target in _links(page) if not target.exists() and not _is_generated(target)]
        assert missing == [], page


def _is_generated(target: Path) -> bool:
    return target.relative_to(ROOT).as_posix() in ("docs/reference/commands.md", "docs/reference/http.md")


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_question_is_answered_within_two_links(question, reachable):
    for place in QUESTIONS[question]:
        name, _, anchor = place.partition("#")
        page = ROOT / "docs" / name
        assert page in reachable, place
        assert anchor in _anchors(page), place
    assert question in _headings(ROOT / "docs/faq.md")


def test_a_question_has_a_short_answer():
    parts = (ROOT / "docs/faq.md").read_text().split("\n## ")[1:]
    long = [part.partition("\n")[0] for part in parts if part.partition("\n")[0] in QUESTIONS and part.count("\n") > 12]
    assert long == []


def test_the_readme_is_one_page():
    text = README.read_text()
    assert len(text.splitlines()) <= 80
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == [
        "You want the simulated robot alone", "You have arms", "You do research", "You change something",
    ]  # fmt: skip
    assert re.search(r"!\[[^\]]+\]\((docs/measured/[\w.]+)\)", text)


def test_the_site_has_the_same_first_page():
    from hook import first_page

    page = first_page((ROOT / "docs/index.md").read_text())
    assert page.startswith(README.read_text().partition("**Next**")[0])
    assert page.count("\n# ") == 0
    assert "\n## All pages" in page
    assert "](LICENSE)" not in page
