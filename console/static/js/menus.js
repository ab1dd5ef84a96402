// Menus that fold: <details class="menu">. One closes by a choice, by Escape, and by a press elsewhere.

export function startMenus() {
  const open = () => document.querySelectorAll("details.menu[open]");
  document.addEventListener("pointerdown", ({ target }) => open().forEach((menu) => menu.contains(target) || (menu.open = false)));
  window.addEventListener("blur", () => open().forEach((menu) => (menu.open = false))); // a press in the scene's frame
  document.addEventListener("click", ({ target }) => {
    const menu = target.closest("details.menu");
    if (menu && target.closest("button, a[href]")) menu.open = false;
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    for (const menu of open()) {
      menu.open = false;
      menu.querySelector("summary").focus();
    }
  });
}
