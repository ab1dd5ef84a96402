// One panel of several: the chosen one is kept for the next visit.

const KEY = `rtstack.tab ${location.pathname}`;

export function startTabs(bar) {
  const tabs = [...bar.querySelectorAll("[role=tab]")];
  const show = (chosen) => {
    for (const tab of tabs) {
      const here = tab === chosen;
      tab.setAttribute("aria-selected", String(here));
      tab.tabIndex = here ? 0 : -1;
      document.getElementById(tab.getAttribute("aria-controls")).hidden = !here;
    }
    localStorage.setItem(KEY, chosen.id);
  };
  for (const tab of tabs) tab.addEventListener("click", () => show(tab));
  bar.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = tabs[(tabs.indexOf(document.activeElement) + step + tabs.length) % tabs.length];
    show(next);
    next.focus();
  });
  const named = [location.hash.slice(1), localStorage.getItem(KEY)]; // a link may choose one
  show(named.map((id) => tabs.find((tab) => tab.id === id)).find(Boolean) ?? tabs[0]);
}
