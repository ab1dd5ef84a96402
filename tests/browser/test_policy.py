"""The operator lets a policy lead on the page Operate, and takes its lease back, in a real Chromium."""

import os
import subprocess

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import COMMAND
from tests.support.console.chromium import READY_MS

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(600)]
PATIENCE_MS = 60_000


@pytest.fixture
def policy(console, temporary, logs_of_stack, learned_grab):
    """A policy that has connected under the name of its token."""
    environment = {**os.environ, "XDG_CONFIG_HOME": str(temporary / "config")}
    create = [COMMAND, "token", "create", "--name", "grabber", "--scope", "operate", "--logs", logs_of_stack]
    token = subprocess.run(create, env=environment, capture_output=True, text=True, check=True).stdout.strip()
    address = console.address.split("?")[0].rstrip("/")
    process = subprocess.Popen(
        [COMMAND, "policy", "scripted_grab", "--token", token, "--console", address],
        env=environment, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    yield process
    process.terminate()
    process.communicate(timeout=60)


def test_the_operator_lets_a_policy_lead_and_takes_its_lease_back(console, policy):
    page = console.page
    page.goto("/")
    page.click("#tab-hand")
    expect(page.locator("#policies")).to_be_visible(timeout=PATIENCE_MS)
    expect(page.locator("#policy")).to_have_value("grabber")
    console.arm()
    expect(page.locator("#lend")).to_be_disabled()  # nothing runs
    page.check("input[name=release][value=hold]", force=True)
    page.click("#practise")
    expect(page.locator("#clutch")).to_have_attribute("data-state", "ready", timeout=READY_MS)
    page.click("#lend")
    expect(page.locator("#policy-line")).to_contain_text("grabber leads", timeout=PATIENCE_MS)
    expect(page.locator("#lend")).to_have_text("Take back")
    page.click("#lend")
    expect(page.locator("#lend")).to_have_text("Let it lead", timeout=PATIENCE_MS)
    page.click("#finish")
    expect(page.locator("#job-line")).to_contain_text("succeeded", timeout=READY_MS)
    policy.terminate()
    expect(page.locator("#policies")).to_be_hidden(timeout=PATIENCE_MS)
    assert console.errors == []
