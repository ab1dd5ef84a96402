"""The scene's page in a real browser, whose connection is broken."""

import asyncio
import gc

import pytest
from playwright.sync_api import sync_playwright
from websockets.asyncio.server import ServerConnection

from console.scene.scenes import Detail
from tests.support.console.chromium import ARGUMENTS, CHROMIUM, NODES, in_scene


def drop_connections(server):
    """Close what viser's server serves now."""
    loop = server.viser._websock_server._background_event_loop
    for connection in [thing for thing in gc.get_objects() if isinstance(thing, ServerConnection)]:
        if connection.loop is loop:
            asyncio.run_coroutine_threadsafe(connection.close(), loop).result(timeout=20.0)


FORM_AMONG_VIEWS = """async () => {
  const { Plan } = await import("/static/js/plan.js");
  const form = document.createElement("form");
  const field = (value) => Object.assign(document.createElement("input"), { value });
  const elements = { object: field("told"), reference: document.createElement("select") };
  for (const name of ["displacement_mm", "displacement_x_mm", "yaw_deg"]) elements[name] = field("0");
  Object.defineProperty(form, "elements", { value: elements });
  const view = { status: { holder: null }, you: "ada", unreachable: null };
  new Plan(form, { onView: (listener) => setInterval(() => listener(view), 20) });
}"""


@pytest.fixture
def page(served):
    """Give a page that is signed in."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        page = browser.new_page()
        page.goto(f"{served.base}/?token={served.parts.sign_in.token}")
        yield page
        browser.close()


@pytest.mark.browser
def test_a_form_is_told_to_the_scene_while_views_come_fast(page):
    """Each view before it was told put the request off by a time that the next view did not leave."""
    told = "told"
    with page.expect_request(lambda sent: sent.url.endswith("/api/scene/plan") and told in (sent.post_data or "")):
        page.evaluate(FORM_AMONG_VIEWS)


@pytest.mark.browser
def test_a_scene_that_nobody_has_clicked_in_connects_again(served, page):
    """viser's page connects again only while it has the focus, which is the page's around it."""
    server = served.parts.scenes.server(Detail.LIGHT)
    in_scene(page, NODES, lambda nodes: "/left" in nodes)
    page.click("#tab-trial")
    drop_connections(server)
    server.viser.scene.add_frame("/later")
    in_scene(page, NODES, lambda nodes: "/later" in nodes)
