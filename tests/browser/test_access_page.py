"""The page Access in a real Chromium: a token that is shown once, works and ends; a viewer who is invited."""

import re

import httpx
import pytest
from playwright.sync_api import expect

from tests.support.console.served_console import serve_console

pytestmark = pytest.mark.browser
PATIENCE_MS = 60_000


@pytest.mark.long
def test_a_token_is_made_used_and_revoked_and_a_viewer_is_invited(browser, tmp_path):
    with serve_console(tmp_path) as served:
        context = browser.new_context(base_url=served.base, permissions=["clipboard-read", "clipboard-write"])
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(f"/?token={served.parts.sign_in.token}")
        page.click("#further")
        page.click(".rail a[href='/access']")
        expect(page.locator("#me")).to_contain_text("may operate", timeout=PATIENCE_MS)
        expect(page.locator("#no-token")).to_be_visible(timeout=PATIENCE_MS)
        page.fill("#token input[name=name]", "<b>plotter")
        page.select_option("#token select[name=scope]", "operate")
        page.click("#token button[type=submit]")
        word = page.locator("#made code").inner_text()
        page.click("#made button")
        expect(page.locator("#made button")).to_have_text("Copied", timeout=PATIENCE_MS)
        assert page.evaluate("navigator.clipboard.readText()") == word
        row = page.locator("#tokens tbody tr")
        expect(row).to_contain_text("<b>plotter", timeout=PATIENCE_MS)
        expect(row).to_contain_text("not since this console started")
        headers = {"authorization": f"Bearer {word}"}
        assert (
            httpx.get(f"{served.base}/api/me", headers=headers, trust_env=False, timeout=60.0).json()["scope"]
            == "operate"
        )
        expect(row.locator("td").nth(3)).to_have_text(re.compile(r"^\d{4}-\d\d-\d\d"), timeout=PATIENCE_MS)

        page.click("#invite button[type=submit]")
        address = page.locator("#invited code").inner_text()
        other = browser.new_context()
        viewer = other.new_page()
        viewer.goto(address)
        viewer.goto(f"{served.base}/access")
        expect(viewer.locator("#me")).to_contain_text("may look", timeout=PATIENCE_MS)
        for form in ("invite", "token"):
            expect(viewer.locator(f"#{form} button[type=submit]")).to_be_disabled()
            expect(viewer.locator(f"#{form} [data-why]")).to_contain_text("ask an operator")
        expect(viewer.locator("#tokens tbody tr")).to_have_count(0)
        viewer.click("#sign-out")
        expect(viewer.locator("h1")).to_have_text("Not signed in", timeout=PATIENCE_MS)
        other.close()

        page.reload()
        expect(row).to_have_count(1, timeout=PATIENCE_MS)
        assert word not in page.content()  # once
        row.get_by_text("Revoke").click()
        question = page.get_by_role("alertdialog")
        expect(question).to_contain_text("Revoke the token of <b>plotter?")
        page.keyboard.press("Escape")
        expect(question).to_have_count(0)
        expect(row.get_by_text("Revoke")).to_be_focused()
        expect(row).to_have_count(1)
        row.get_by_text("Revoke").click()
        question.get_by_text("Revoke", exact=True).click()
        expect(row).to_have_count(0, timeout=PATIENCE_MS)
        assert httpx.get(f"{served.base}/api/me", headers=headers, trust_env=False, timeout=60.0).status_code == 401
        expect(page.locator("#audit tbody")).to_contain_text("revoked token", timeout=PATIENCE_MS)
        expect(page.locator("#errors .error")).to_have_count(0)
        context.close()
