// What the keyboard needs on every page: Space is STOP's, so that Enter ticks boxes; Enter in a field moves no arm; "?"
// shows the list of keys; the menu of further pages.

import { closeDialog, openDialog } from "./dialog.js";
import { isTextField } from "./stop.js";

const SETTLED_MS = 400;
let moved = null; // the button to which the page has moved the focus last
let movedMs = 0;

// The focus goes on to a button that has come. A key that is held does not press it; a double press undoes nothing.
export function moveFocus(button) {
  button.focus();
  [moved, movedMs] = [button, performance.now()];
}

export function startKeyboard() {
  const help = document.getElementById("help");
  const close = document.getElementById("help-close");
  const further = document.getElementById("further-pages");
  const show = () => openDialog(help, close);
  further.addEventListener("click", () => further.hidePopover()); // first: the focus goes back to what has opened it
  document.getElementById("keys").addEventListener("click", show);
  further.addEventListener("toggle", ({ newState }) => document.getElementById("further").setAttribute("aria-expanded", String(newState === "open")));
  window.addEventListener("blur", () => further.hidePopover()); // a press in the scene's frame
  close.addEventListener("click", () => closeDialog());
  window.addEventListener("keydown", (event) => {
    const { target } = event;
    if (event.key === "Enter" && target.form?.matches("[data-moves]") && !target.matches("button")) {
      event.preventDefault();
      const button = target.form.querySelector("[type=submit]");
      if (event.ctrlKey && !event.repeat && !button.disabled) target.form.requestSubmit(button);
      return;
    }
    const undoes = target === moved && ["cancel", "disarm"].includes(target.id);
    const twice = event.repeat || (undoes && performance.now() - movedMs < SETTLED_MS);
    if (event.key === "Enter" && twice && target.matches("button")) return event.preventDefault();
    if (event.ctrlKey || event.altKey || event.metaKey || isTextField(target)) return;
    if (event.key === "?" && !help.open) show();
    else if (event.key === "Enter" && target.type === "checkbox" && !event.repeat) target.click();
    else return;
    event.preventDefault();
  });
  // what was sent is done with: the field has the focus, and the keys, no more
  window.addEventListener("submit", () => isTextField(document.activeElement) && document.activeElement.blur());
}
