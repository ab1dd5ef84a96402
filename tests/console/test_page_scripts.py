"""The pages' scripts: what one takes from another is there. A browser says nothing until the page is opened."""

import re
from pathlib import Path

import pytest

from console.templates import _digest

FOLDER = Path(__file__).parents[2] / "console" / "static" / "js"
TAKEN = re.compile(r'^import \{([^}]+)\} from "([^"]+)";', re.MULTILINE)
GIVEN = re.compile(r"^export (?:async )?(?:function|class|const|let) (\w+)", re.MULTILINE)


@pytest.mark.parametrize("script", sorted(FOLDER.rglob("*.js")), ids=lambda path: str(path.relative_to(FOLDER)))
def test_every_name_that_a_script_imports_is_exported(script):
    for names, module in TAKEN.findall(script.read_text()):
        source = (script.parent / module).resolve()
        assert source.is_file(), f"{script.name} imports {module}"
        taken = {name.split(" as ")[0].strip() for name in names.split(",") if name.strip()}
        missing = taken - set(GIVEN.findall(source.read_text()))
        assert not missing, f"{script.name} takes {missing} from {module}, which does not export it"


def test_what_a_page_loads_is_kept_by_the_browser_until_it_changes(served):
    with served.signed_in() as (client, _):
        loaded = set(re.findall(r'"(/static/kept-[^"]+)"', client.get("/").text))
        assert len(loaded) > 50
        for address in loaded:
            answer = client.get(address).raise_for_status()
            assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
        address = loaded.pop()
        plain = client.get(re.sub("kept-[^/]+/", "", address)).raise_for_status()
        assert (plain.headers["cache-control"], plain.content) == ("no-store", client.get(address).content)
        assert client.get("/static/kept-/../../app.py").status_code in (401, 404)
        assert client.get("/static/kept-x/../../app.py".replace("..", "%2e%2e")).status_code == 404
    assert _digest(1) == _digest(2)  # of the same content
