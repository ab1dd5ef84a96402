"""The pages' scripts: what one takes from another is there. A browser says nothing until the page is opened."""

import re
from pathlib import Path

import pytest

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
