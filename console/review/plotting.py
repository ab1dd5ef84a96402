"""plotly.js, as the installed package brings it: nothing of it is kept here."""

from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

PLOTLY_PATH = f"/assets/plotly-{version('plotly')}.min.js"


# plotly.js looks for an element of this name before it adds the style sheet of its maps, which we do not draw
MAPLIBRE_STYLE = "9f215cf04c5486422605d13261cb87401f4e7763b6296af81e98efbc0130da53"


def _installed() -> Path:
    spec = find_spec("plotly")  # found, not imported: the package takes a second, we want one of its files
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "package_data" / "plotly.min.js"


PLOTLY_FILE = _installed()
