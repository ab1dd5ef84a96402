"""A page's script with all that it imports: a browser that is told of them at once need not find them one by one."""

import re
from functools import cache
from pathlib import Path, PurePosixPath

from markupsafe import Markup

_FOLDER = Path(__file__).parent / "static" / "js"
_IMPORT = re.compile(r"""^import\s[^"';]*["'](\.[^"']+)["'];""", re.MULTILINE)


@cache
def imported(name: str) -> tuple[str, ...]:
    """Return the modules that a module imports, and what they import, each once; paths below static/js."""
    found: dict[str, None] = {}
    for other in _IMPORT.findall((_FOLDER / name).read_text()):
        path = (_FOLDER / PurePosixPath(name).parent / other).resolve().relative_to(_FOLDER.resolve()).as_posix()
        found |= dict.fromkeys((path, *imported(path)))
    return tuple(found)


def page_script(name: str) -> Markup:
    """Return the tags for a page's script: what it imports is fetched beside it, not after it."""
    tags = [Markup('<link rel="modulepreload" href="/static/js/{}">').format(path) for path in imported(name)]
    return Markup("\n  ").join([*tags, Markup('<script type="module" src="/static/js/{}"></script>').format(name)])
