// STOP: the button, and the space bar anywhere but in a text field, in the scene's frame too. It never asks.

import { post } from "./api.js";
import { closeDialog } from "./dialog.js";
import { showError } from "./errors.js";

const TEXT_TYPES = new Set(["text", "search", "number", "email", "url", "password", "tel"]);

export function isTextField(element) {
  if (!element) return false;
  if (element.tagName === "TEXTAREA" || element.isContentEditable) return true;
  return element.tagName === "INPUT" && TEXT_TYPES.has(element.type);
}

export async function stop() {
  const button = document.getElementById("stop");
  button.dataset.state = "requested";
  closeDialog(); // a question about a motion is out of date
  try {
    await post("/api/stop");
  } catch (error) {
    delete button.dataset.state;
    showError(`STOP was not delivered, the robot goes on: ${error.message} Use the robot's own stop.`);
  }
}

// Captured before other listeners: a focused button must not take the space bar for itself.
export function listenForSpace(target) {
  const swallow = (event) => {
    if (event.code !== "Space" || isTextField(event.target)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.type === "keydown" && !event.repeat) stop();
  };
  target.addEventListener("keydown", swallow, { capture: true });
  target.addEventListener("keyup", swallow, { capture: true });
}

export function startStop(live) {
  const button = document.getElementById("stop");
  button.addEventListener("click", stop);
  listenForSpace(window);
  live.onView((view) => {
    const job = view.status?.job;
    const active = job && ["starting", "running", "stopping"].includes(job.state);
    if (active && view.status.stop_requested) button.dataset.state = "requested";
    else if (!active) delete button.dataset.state;
    const text = active && view.status.stop_requested ? "STOPPING" : "STOP";
    if (button.textContent !== text) button.textContent = text;
  });
}
