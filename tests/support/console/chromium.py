"""The browser of the tests, and the options that it gets."""

from playwright.sync_api import Page

CHROMIUM = "/usr/bin/chromium"  # Debian's
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--disable-background-networking",
]


def leave_scene_undrawn(page: Page) -> None:
    """Serve the scene's frame without its drawing, which a machine without a graphics card would have to do itself."""
    page.route("**/viser/**", lambda route: route.fulfill(content_type="text/html", body="<p id=drawn>scene</p>"))
