// Before anything is drawn: the theme that was chosen, or the system's. A plain script, so that no page is shown in the
// other one first.

document.documentElement.dataset.theme =
  localStorage.getItem("rtstack.theme") ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
