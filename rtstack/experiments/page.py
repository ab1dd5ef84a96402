"""The page that a campaign ends in: one HTML file that needs nothing else, its figures inside."""

import base64
import html
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

PAGE = "report.html"


def page_template(name: str, package: str) -> Template:
    """Return the template `name` of a package's folder `pages`; it may include what all pages share, which is here."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(each, "pages") for each in (package, "rtstack.experiments")]),
        autoescape=True, undefined=StrictUndefined, trim_blocks=True,
    )  # fmt: skip
    return environment.get_template(name)


def embedded(path: Path, caption: str) -> Markup:
    """Return a figure as HTML that holds its picture."""
    data = base64.b64encode(path.read_bytes()).decode()
    text = html.escape(caption)
    return Markup(
        f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text} '
        f"<code>{path.parent.name}/{path.name}</code></figcaption></figure>"
    )
