"""The curves of the review's page, as the page itself has drawn them."""

from typing import Any

from playwright.sync_api import Page

DRAWN = """async name => {
    const page = await import(document.querySelector('script[type=module]').src); // what it has drawn itself
    const { chart } = page.plots;
    return chart.curves.filter(curve => curve.name === name)
        .map(({x, y, colour, pane}) => ({x: [...x], y: [...y], colour, ...chart.panes[pane]}));
}"""


def drawn(page: Page, name: str) -> list[dict[str, Any]]:
    """Return a signal's curves as they were drawn, the compared log's second: x s, y, colour; top, bottom px, range."""
    return page.evaluate(DRAWN, name)
