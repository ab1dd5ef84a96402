// STOP: the button, and the space bar. It never asks. While anything moves, or the page does not know, the space bar
// stops wherever the focus is, in the scene's frame too; else a text field keeps it for a space.

import { post } from "./api.js";
import { closeDialog } from "./dialog.js";
import { forgetErrors, showError } from "./errors.js";

const TEXT_TYPES = new Set(["text", "search", "email", "url", "password", "tel"]);
const OLD_S = 0.5;

const SEEN_MS = 1000; // within it, arms that STOP has reached are at rest

let mayMove = () => true;
let say = () => {}; // by the live socket, which is open already: a request may have to wait for a connection

export function isTextField(element) {
  if (!element) return false;
  if (element.tagName === "TEXTAREA" || element.isContentEditable) return true;
  return element.tagName === "INPUT" && TEXT_TYPES.has(element.type);
}

export async function stop() {
  const button = document.getElementById("stop");
  button.dataset.state = "requested";
  say("stop");
  closeDialog(); // a question about a motion is out of date
  try {
    await post("/api/stop");
  } catch (error) {
    say("report stop");
    await new Promise((resolve) => setTimeout(resolve, SEEN_MS));
    delete button.dataset.state;
    const bySocket = error.status === null && !mayMove();
    const what = bySocket
      ? "STOP went by the live connection alone, and nothing moves"
      : "STOP was not delivered, the robot goes on";
    showError(`${what}: ${error.message} Use the robot's own stop.`, "worst", error.status === null && !bySocket ? "stop" : "");
  }
}

// Captured before other listeners: a focused button must not take the space bar for itself.
export function listenForSpace(target) {
  const swallow = (event) => {
    if (event.code !== "Space") return;
    const typed = isTextField(event.target) && event.target.role !== "spinbutton"; // a number has no space
    if (typed && !mayMove()) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.type === "keydown" && !event.repeat) stop();
  };
  target.addEventListener("keydown", swallow, { capture: true });
  target.addEventListener("keyup", swallow, { capture: true });
}

// live: the live state, null on a page that has none.
export function startStop(live) {
  const button = document.getElementById("stop");
  button.addEventListener("click", stop);
  listenForSpace(window);
  if (live === null) return;
  say = (word) => live.say(word);
  mayMove = () => live.since() > OLD_S || live.view.state.active;
  live.onView((view) => {
    if (!view.state.active) forgetErrors("stop"); // nothing goes on
    const job = view.status?.job;
    const active = job && ["starting", "running", "stopping"].includes(job.state);
    if (active && view.status.stop_requested) button.dataset.state = "requested";
    else if (!active) delete button.dataset.state;
    const text = active && view.status.stop_requested ? "STOPPING" : "STOP";
    if (button.textContent !== text) button.textContent = text;
    button.dataset.word = text; // the longer one is set smaller
  });
}
