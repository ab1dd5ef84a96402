// What the keyboard needs on every page: Space is STOP's, so that Enter ticks boxes; "?" shows the list of keys.

import { isTextField } from "./stop.js";

export function startKeyboard() {
  const help = document.getElementById("help");
  document.getElementById("keys").addEventListener("click", () => help.showModal());
  document.getElementById("help-close").addEventListener("click", () => help.close());
  window.addEventListener("keydown", (event) => {
    const { target } = event;
    if (event.ctrlKey || event.altKey || event.metaKey || isTextField(target)) return;
    if (event.key === "?" && !help.open) help.showModal();
    else if (event.key === "Enter" && target.type === "checkbox" && !event.repeat) target.click();
    else return;
    event.preventDefault();
  });
}
