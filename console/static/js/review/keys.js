// The keyboard: every key of the list that the page shows with "?". Space is STOP's.

import { isTextField } from "../stop.js";

export function startKeys(view, timeline, marks, cameras, notes) {
  const help = document.getElementById("help");
  const actions = {
    p: () => timeline.play(!timeline.playing),
    ArrowLeft: (event) => timeline.step(event.shiftKey ? -10 : -1),
    ArrowRight: (event) => timeline.step(event.shiftKey ? 10 : 1),
    "[": () => marks.step(-1),
    "]": () => marks.step(1),
    ",": () => cameras.step(-1),
    ".": () => cameras.step(1),
    "+": () => view.zoom(0.5),
    "-": () => view.zoom(2),
    n: () => notes.begin(),
    0: () => view.setWindow(0, view.end),
  };
  window.addEventListener("keydown", (event) => {
    const action = actions[event.key] ?? actions[event.key.toLowerCase()];
    if (!action || event.ctrlKey || event.altKey || event.metaKey || help.open) return;
    if (isTextField(event.target) || event.target.tagName === "SELECT") return;
    event.preventDefault();
    action(event);
  });
}
