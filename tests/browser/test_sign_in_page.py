"""The sign-in page's forms in a real Chromium: a code, and the token of an address that another site has led to."""

import pytest
from playwright.sync_api import expect

from rtstack.access.tokens import Scope
from tests.support.console.served_console import serve_console
from tests.support.console.stage import PATIENCE_MS

pytestmark = pytest.mark.browser
OTHER = "http://other.test/"


def test_a_code_and_a_confirmed_token_sign_a_browser_in(browser, tmp_path):
    with serve_console(tmp_path) as served:
        context = browser.new_context(base_url=served.base)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto("/")
        code = served.parts.sign_in.pair(Scope.VIEW)
        wrong = f"{(int(code) + 1) % 10**6:06d}"
        for typed in (wrong, f"{code[:3]} {code[3:]}"):
            page.fill("input[name=code]", typed)
            page.click("button[type=submit]")
            if typed == wrong:
                expect(page.locator("#refused")).to_contain_text("each works once")
        expect(page.locator("#control-light")).to_be_visible()
        assert page.url == f"{served.base}/"
        assert page.request.get("/api/me").json()["operator"] == "viewer 1"

        address = f"{served.base}/?token={served.parts.sign_in.token}"
        page.route(OTHER, lambda route: route.fulfill(content_type="text/html", body=f'<a href="{address}">go</a>'))
        page.goto(OTHER)
        page.click("a")
        expect(page.locator("h1")).to_have_text("Sign in?")
        page.click("button[type=submit]")
        expect(page.locator("#control-light")).to_be_visible()
        assert page.url == f"{served.base}/"
        assert page.request.get("/api/me").json()["operator"] == "operator 2"
        context.close()
