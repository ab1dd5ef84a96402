// What the keyboard needs on every page: Space is STOP's, so that Enter ticks boxes; "?" shows the list of keys.

import { closeDialog, openDialog } from "./dialog.js";
import { isTextField } from "./stop.js";

export function startKeyboard() {
  const help = document.getElementById("help");
  const close = document.getElementById("help-close");
  const show = () => openDialog(help, close);
  document.getElementById("keys").addEventListener("click", show);
  close.addEventListener("click", () => closeDialog());
  window.addEventListener("keydown", (event) => {
    const { target } = event;
    if (event.ctrlKey || event.altKey || event.metaKey || isTextField(target)) return;
    if (event.key === "?" && !help.open) show();
    else if (event.key === "Enter" && target.type === "checkbox" && !event.repeat) target.click();
    else return;
    event.preventDefault();
  });
}
