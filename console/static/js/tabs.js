// One panel of several: the chosen one is kept for the next visit.

const KEY = `rtstack.tab ${location.pathname}`;

// bar: of the tabs; those in a menu inside of it are named by the menu while one of them is chosen.
export function startTabs(bar) {
  const tabs = [...bar.querySelectorAll("[role=tab]")];
  const menu = bar.querySelector("details");
  const more = menu?.querySelector("summary");
  const show = (chosen) => {
    for (const tab of tabs) {
      const here = tab === chosen;
      tab.setAttribute("aria-selected", String(here));
      tab.tabIndex = here || menu?.contains(tab) ? 0 : -1;
      document.getElementById(tab.getAttribute("aria-controls")).hidden = !here;
    }
    if (menu) {
      more.textContent = menu.contains(chosen) ? chosen.textContent : "More";
      more.dataset.chosen = String(menu.contains(chosen));
    }
    localStorage.setItem(KEY, chosen.id);
  };
  for (const tab of tabs) tab.addEventListener("click", () => show(tab));
  bar.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const seen = tabs.filter((tab) => tab.checkVisibility());
    const next = seen[(seen.indexOf(document.activeElement) + step + seen.length) % seen.length];
    show(next);
    next.focus();
  });
  const named = [location.hash.slice(1), localStorage.getItem(KEY)]; // a link may choose one
  show(named.map((id) => tabs.find((tab) => tab.id === id)).find(Boolean) ?? tabs[0]);
}
