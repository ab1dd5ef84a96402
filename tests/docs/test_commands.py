"""Every command and example of the documentation works, or says why a test cannot run it, and exists.

RTSTACK_DOCS=all (`make program NAME=deeper ARGS=docs-commands`) also runs those that take minutes.
"""

import os
from collections import Counter
from pathlib import Path

import pytest

from tests.support.docs.blocks import PAGES, ROOT, RUNBOOK, Block, Use, blocks_of, inline_commands
from tests.support.docs.parser import commands_of, problem_of, unknown_word
from tests.support.docs.run import Page

USES = {Use.RUN, Use.FILE, Use.BACKGROUND} | ({Use.SLOW} if os.environ.get("RTSTACK_DOCS") == "all" else set())
# blocks outside of the runbook that CI does not run, by their titles: who marks another one counts it here
NOT_RUN = {
    "takes minutes": 11,
    "on the robot's PC": 6,
    "in real time": 2,
    "on several machines": 2,
    "from a clone": 11,
    "while rtstack up runs": 5,
    "on a desktop": 2,
}
# pages that install examples/learned_grab
WITH_LEARNED_GRAB = ("docs/howto/policy.md",)
# whose commands take long, and are those of tests/cli and tests/deploy too
LONG = (
    "docs/quickstart.md",
    "docs/tutorial.md",
    *(
        f"docs/howto/{name}.md"
        for name in ("cell", "dataset", "desk", "hal", "notebook", "one_arm", "policy", "review", "robot")
    ),
)


def _uses(page: Path) -> list[Block]:
    return [block for block in blocks_of(page) if block.use in USES]


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.long] if _name(page) in LONG else [], id=_name(page))
        for page in PAGES
        if _uses(page)
    ],
)
def test_what_a_page_says_works(page, tmp_path, monkeypatch, command_line, request):
    if _name(page) in WITH_LEARNED_GRAB:
        request.getfixturevalue("learned_grab")
    folder = tmp_path / "page"
    folder.mkdir()
    reader = Page(folder, monkeypatch.chdir, command_line)
    try:
        for block in _uses(page):
            reader.read(block)
        reader.close()
    finally:
        reader.abandon()


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_command_exists(page):
    problems = [
        f"{block.place}: {' '.join(words)}: {problem}"
        for block in blocks_of(page)
        if block.language in ("bash", "console")
        for words in commands_of(block)
        if (problem := problem_of(words)) is not None
    ]
    problems += [f"{command}: no {word}" for command in inline_commands(page) if (word := unknown_word(command))]
    assert problems == []


def test_what_is_not_run_is_counted():
    blocks = [block for page in PAGES for block in blocks_of(page) if not page.is_relative_to(RUNBOOK)]
    assert Counter(block.title for block in blocks if block.use in (Use.SLOW, Use.CHECKED)) == NOT_RUN


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("```bash\nrtstack trail --reference x\n```", "trail"),
        ("```bash\nrtstack trial --reference x --sed 3\n```", "--sed"),
        ("```bash\nfor n in 1 2; do rtstack bench tock; done\n```", "tock"),
        ("```console\n$ rtstack trial --reference x --seed many\n```", "--seed"),
        ('```bash title="on the robot\'s PC"\nsudo make fauls\n```', "fauls"),
        ("```bash\npython examples/99_none.py\n```", "99_none"),
    ],
)
def test_a_command_that_does_not_exist_is_found(tmp_path, monkeypatch, text, word):
    monkeypatch.setattr("tests.support.docs.blocks.ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(text)
    (block,) = blocks_of(page)
    (problem,) = [found for words in commands_of(block) if (found := problem_of(words)) is not None]
    assert word in problem


@pytest.mark.parametrize("text", ["```\nrtstack up\n```", "    rtstack up\n", '```bash title="some day"\nls\n```'])
def test_no_block_escapes_the_tests(tmp_path, monkeypatch, text):
    monkeypatch.setattr("tests.support.docs.blocks.ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(ValueError, match=r"page\.md:1"):
        list(blocks_of(page))


def test_what_python_prints_is_compared_where_the_page_says_it(tmp_path, monkeypatch, command_line):
    monkeypatch.setattr("tests.support.docs.blocks.ROOT", tmp_path)
    page, folder = tmp_path / "page.md", tmp_path / "page"
    folder.mkdir()
    reader = Page(folder, monkeypatch.chdir, command_line)
    blocks = ("print(6 * 7, 'of', id(0))\n# > 42 of ...", "print(6 * 7)\n# > 43")
    page.write_text("".join(f"```python\n{block}\n```\n\n" for block in blocks))
    right, wrong = blocks_of(page)
    reader.read(right)
    with pytest.raises(AssertionError, match=r"page\.md:6: expected:\s+43\s+printed:\s+42"):
        reader.read(wrong)
