"""Where the focus is, what is open, on which page, how wide and at which moment, when STOP is pressed; its arrival."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from playwright.sync_api import Page, expect

from tests.support.console.served_console import ServedConsole


@dataclass(frozen=True)
class Way:
    """page: its path; focus: what is clicked before, or opened by a key; dialog: what is open; how: key or button."""

    page: str
    focus: str
    dialog: str
    width: int
    moment: str
    how: str

    def __str__(self):
        return "-".join(str(part) for part in vars(self).values()).replace("/", "_").replace(" ", "_")


WAYS = [
    Way(*row)
    for row in (
        ("/", "body", "", 1280, "moving", "Space"),
        ("/", "#trial input[name=displacement_mm]", "", 1280, "moving", "Space"),
        ("/", "#trial input[name=displacement_mm]", "", 1280, "armed", "Space"),
        ("/", "#filter", "", 1280, "moving", "Space"),
        ("/", "#filter", "", 1920, "preparing", "Space"),
        ("/", "#filter", "", 390, "holding", "Space"),
        ("/", "#operator", "", 820, "guided", "Space"),
        ("/", "#demonstration select", "", 1280, "moving", "Space"),  # its list is open
        ("/", "#demonstration select", "", 1280, "moving", "button"),
        ("/", "#stiffness", "", 1280, "moving", "Space"),
        ("/", "#scene", "", 1280, "moving", "Space"),
        ("/", "#scene", "", 390, "moving", "button"),
        ("/", "body", "help", 1280, "moving", "Space"),
        ("/", "body", "help", 1280, "moving", "button"),
        ("/", "body", "help", 390, "moving", "button"),
        ("/", "body", "", 390, "fault", "button"),
        ("/trials", "#trial input[name=seeds]", "", 1280, "moving", "Space"),
        ("/trials", "#theme", "", 1280, "preparing", "Space"),
        ("/campaigns", "#report-frame", "", 1280, "moving", "Space"),
        ("/logs", "#query", "", 1280, "moving", "Space"),
        ("/logs/{log}", "#signal-search", "", 1280, "moving", "Space"),
        ("/logs/{log}", "#slider", "", 820, "moving", "Space"),
        ("/recordings/{log}", "#note", "", 1280, "moving", "Space"),
        ("/recordings/{log}", "#discard", "question", 1280, "moving", "Space"),
        ("/recordings/{log}", "#discard", "question", 1280, "moving", "button"),
        ("/recordings/{log}", "#discard", "question", 390, "moving", "button"),
        ("/access", "#token input[name=name]", "", 1280, "moving", "Space"),
        ("/api", ".swagger-ui a", "", 1280, "moving", "Space"),
        ("/recovery", ".rail a", "", 390, "moving", "Space"),
        ("/no/such/page", "body", "", 1280, "moving", "Space"),
    )
]


def come_to(page: Page, way: Way, base: str, ids: dict[str, str]) -> None:
    """Open a way's page in its width. ids: of logs, by the names in its path."""
    page.set_viewport_size({"width": way.width, "height": 844 if way.width < 1280 else 720})
    address = base + way.page.format(**ids)
    if page.url != address:
        page.goto(address)
    page.keyboard.press("Escape")  # the list of a select, or the menu, that the last way has left open
    expect(page.locator("#control-light")).not_to_have_attribute("data-state", "waiting")
    if way.page == "/":
        tab = way.focus.split()[0].removeprefix("#")
        page.click(f"#tab-{tab if tab in ('demonstration', 'trial') else 'hand'}")
    if way.focus == "#report-frame":
        shown = "frame => { document.querySelector('main').prepend(frame); frame.hidden = false; }"
        page.locator("#report-frame").evaluate(shown)
        page.locator("#report-frame").evaluate("frame => { frame.srcdoc = '<p id=drawn>A report</p>'; }")


def lead_focus(page: Page, way: Way) -> None:
    """Put the focus where a way has it, and open its dialog."""
    if way.focus in ("#scene", "#report-frame"):
        page.frame_locator(way.focus).locator("#drawn, canvas").first.evaluate(
            "drawn => { drawn.tabIndex = 0; drawn.ownerDocument.defaultView.focus(); drawn.focus(); }"
        )
    elif way.focus == "#theme":
        page.click("#further")
        page.focus("#theme")
    elif way.focus in (".swagger-ui a", ".rail a"):
        page.locator(way.focus).first.focus()
    elif way.focus != "body":
        page.locator(way.focus).first.click()
    if way.dialog == "help":
        page.keyboard.press("?")
        expect(page.locator("#help")).to_be_visible()
    elif way.dialog == "question":
        expect(page.get_by_role("alertdialog")).to_be_visible()


@contextmanager
def arriving(served: ServedConsole, page: Page) -> Iterator[None]:
    """Wait for the STOP that is pressed meanwhile, until all of it is over."""
    assert not served.mailbox.stop_requested
    before = served.stops_told()
    yield
    for _ in range(600):
        if served.mailbox.stop_requested and served.stops_told() > before:
            return
        page.wait_for_timeout(100)
    shown = page.evaluate("[document.activeElement.outerHTML, document.getElementById('errors')?.innerText]")
    raise AssertionError(f"STOP has not arrived: {page.url}, {shown}, {page.locator('#control-light').inner_text()}")
