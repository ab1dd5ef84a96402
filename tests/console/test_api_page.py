"""The page of the HTTP interface in a real browser, and what the description says of every request."""

import pytest
from playwright.sync_api import sync_playwright

from console.routes.description import OPENAPI_PATH
from tests.support.console.look import switch_theme

PATIENCE_MS = 60_000


def test_every_request_has_a_type_a_summary_and_its_refusals(served):
    with served.signed_in() as (client, _):
        document = client.get(OPENAPI_PATH).json()
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            what = f"{method} {path}"
            assert 10 < len(operation["summary"]) < 120, what
            assert operation["tags"], what
            successes = [status for status in operation["responses"] if status.startswith("2")]
            answers = [kinds for one in successes for kinds in operation["responses"][one].get("content", {}).items()]
            assert answers, what
            for kind, answer in answers:
                assert answer["schema"] not in ({}, {"type": "object"}), what
                assert "$ref" in answer["schema"].get("additionalProperties", {"$ref": ""}), what  # a map of a type
                assert kind == "application/json" or answer["schema"]["format"] == "binary", what
            refusals = {status for status in operation["responses"] if status > "299"}
            assert refusals >= {"400", "401", "403"} | ({"413"} if method != "get" else set()), what
            assert "{" not in path or ("422" in refusals and refusals & {"404", "409"}), what
            for status in refusals:
                schema = operation["responses"][status]["content"]["application/json"]["schema"]
                assert schema == {"$ref": "#/components/schemas/Problem"}, (what, status)
    assert len({operation["operationId"] for one in document["paths"].values() for operation in one.values()}) > 30


@pytest.mark.browser
def test_the_page_needs_no_network_keeps_the_policy_and_tries_a_request_out(served):
    wrong = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        ours = (served.base, "data:", f"blob:{served.base}")  # a blob: the answer, as the page offers it for saving
        page.on("request", lambda request: None if request.url.startswith(ours) else wrong.append(request.url))
        page.goto(f"{served.base}/?token={served.parts.sign_in.token}")
        page.goto(f"{served.base}/api")
        stop = page.locator("#operations-control-control_stop")
        stop.locator(".opblock-summary").click()
        assert not served.mailbox.stop_requested
        stop.locator(".try-out__btn").click()
        stop.locator(".execute").click()
        stop.locator(".live-responses-table .microlight").first.wait_for()
        assert served.mailbox.stop_requested
        switch_theme(page)
        assert page.evaluate("document.documentElement.matches('.dark-mode') === (theme.textContent === 'Light theme')")
        browser.close()
    assert wrong == []
