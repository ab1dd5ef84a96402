// A preview of the form's trial, and the hit of the last one in slow motion: what the scene shows as a ghost.

import { get, post } from "./api.js";
import { showError } from "./errors.js";
import { bodyOf } from "./jobs.js";
import { allRead } from "./numbers.js";
import { LOOKS } from "./scope.js";

const LOOK_MS = 300;
const MS = 1000;

function words({ shown, t_s: at, end_s: end, speed, impact_s: impact }) {
  if (shown === "preview") return `Preview, simulated: ${at.toFixed(1)} of ${end.toFixed(1)} s`;
  return `Slow motion, ${speed}x: ${((at - impact) * MS).toFixed(0)} ms from the impact`;
}

export function startGhost(form, live) {
  const [button, strip] = [form.querySelector("#preview"), document.getElementById("ghost")];
  const [text, close] = [strip.querySelector("span"), strip.querySelector("button")];
  const line = form.querySelector("#preview-line");
  let running = false;
  close.addEventListener("click", () => post("/api/scene/ghost/end").catch((error) => showError(`Not closed: ${error.message}`)));

  const look = async () => {
    try {
      const view = await get("/api/jobs/preview");
      running = view.running;
      line.textContent = view.line && `${view.running ? "The trial" : "Preview: it"} ${view.line}.`;
      line.dataset.tone = view.running ? "" : view.success ? "good" : "bad";
      if (running) setTimeout(look, LOOK_MS);
    } catch (error) {
      running = false;
      showError(`The preview is not known: ${error.message}`);
    }
  };

  button.addEventListener("click", async () => {
    if (!allRead(form)) return;
    running = button.disabled = true;
    try {
      await post("/api/jobs/preview", bodyOf(form));
      look();
    } catch (error) {
      running = false;
      showError(`No preview: ${error.message}.`);
    }
  });

  live.onView(({ ghost, status }) => {
    strip.hidden = ghost === null;
    if (ghost !== null) text.textContent = words(ghost);
    const active = ["starting", "running", "stopping"].includes(status?.job?.state);
    const why = LOOKS ?? (active ? "Something moves" : running ? "It is being simulated" : form.elements.reference.value ? null : "Record a demonstration first");
    button.disabled = why !== null;
    button.title = why ?? "Simulate this trial and show it as a ghost; no arm moves";
  });
}
