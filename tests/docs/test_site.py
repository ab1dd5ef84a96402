"""The site builds with warnings as errors, says what the code says, and loads nothing from elsewhere."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

from rtstack.topics import MESSAGES

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs/generate"))

from command_line import commands  # noqa: E402
from http_api import document  # noqa: E402
from public_names import names  # noqa: E402

_LOADING = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}
_LOADED_LINKS = {"stylesheet", "icon", "preload", "preconnect", "modulepreload", "dns-prefetch"}


pytestmark = pytest.mark.long  # `make docs` is the command for it


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, as `make docs` builds it."""
    out = tmp_path_factory.mktemp("docs") / "site"
    command = [str(Path(sys.executable).with_name("mkdocs")), "build", "--strict", "--site-dir", str(out)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


class _Loads(HTMLParser):
    """Collects what a page loads, and its text."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        kinds = set((values.get("rel") or "").split())
        if tag in _LOADING and (tag != "link" or kinds & _LOADED_LINKS):
            self.loaded.append(values.get(_LOADING[tag]) or "")

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def _read(page: Path) -> _Loads:
    found = _Loads()
    found.feed(page.read_text())
    return found


def test_nothing_is_loaded_from_elsewhere(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 20
    loaded = {(page.name, address) for page in pages for address in _read(page).loaded}
    assert loaded
    assert [one for one in loaded if re.match(r"(https?:)?//", one[1])] == []
    styles = "".join(path.read_text() for path in site.rglob("*.css"))
    assert re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", styles) == []
    assert (site / "search/search_index.json").stat().st_size > 10_000


def test_the_first_page_is_the_readme(site):
    text = "".join(_read(site / "index.html").text)
    readme = (ROOT / "README.md").read_text()
    for line in re.findall(r"^(?:## |make )(.+)$", readme, re.MULTILINE):
        assert line in text
    assert "All pages" in text


def test_the_command_line_page_has_every_command_and_option(site):
    text = "".join(_read(site / "reference/commands.html").text)
    assert len(commands()) > 15
    for words, command in commands().items():
        assert words in text
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert parameter.opts[0] in text, (words, parameter.opts)


def test_the_http_page_has_every_path(site):
    text = "".join(_read(site / "reference/http.html").text)
    paths = [path for path in document()["paths"] if path.startswith("/api")]
    assert len(paths) > 20
    for path in paths:
        assert path in text


def test_the_log_page_has_every_field(site):
    text = "".join(_read(site / "reference/log.html").text)
    for message in MESSAGES.values():
        assert message.schema in text
        for field in message.fields:
            assert field.name in text
            assert field.comment in text


def test_every_public_name_is_on_the_page(site):
    found = set(re.findall(r'id="([^"]+)"', (site / "reference/python.html").read_text()))
    assert sorted(names() - found) == []


def test_nothing_is_left_to_be_filled_in(site):
    for page in site.rglob("*.html"):
        # a template that a page shows has calls or attributes there
        assert not re.search(r"\{\{ *\w+ *\}\}", "".join(_read(page).text)), page


def test_the_figures_were_drawn(site):
    for name in ("extension", "interim", "effort", "monitor", "impact_map"):
        assert (site / f"figures/{name}.svg").read_text().count("<path") > 10
