"""What folds on the page Operate: the menus View and More, and the settings of the hand."""

from playwright.sync_api import Page


def choose_tab(page: Page, name: str) -> None:
    """Choose a tab of the menu More."""
    page.click("#more summary")
    page.click(f"#tab-{name}")


def open_settings(page: Page) -> None:
    """Open the settings of the hand, where they are not open."""
    if not page.locator("#drag-holds").is_visible():
        page.click("#settings summary")


def look(page: Page, name: str) -> None:
    """Press a button of the scene's menu View."""
    page.click("#view summary")
    page.locator("#view").get_by_role("button", name=name, exact=True).click()
