// The bottom strip: the last event, and behind it the list of the newest ones.

import { get } from "./api.js";
import { forgetErrors, showError } from "./errors.js";
import { asSentence } from "./faults.js";
import { wordOf } from "./modes.js";

// One time base: the host's clock. The robot's time begins anew with a simulated cell, and two control boxes have two.
function fill(element, event) {
  const time = document.createElement("time");
  const seen = new Date(event.seen_s * 1000);
  time.textContent = `${seen.toTimeString().slice(0, 8)}.${String(seen.getMilliseconds()).padStart(3, "0")}`;
  time.title = `Robot's time, as in its log: ${event.t_s.toFixed(3)} s`;
  const level = document.createElement("span");
  level.className = "level";
  level.dataset.level = event.level;
  level.textContent = event.level;
  const mode = event.name === "mode"; // a change of it, in the words of modes
  const text = mode ? event.text.split(" -> ").map((each) => wordOf(each.toUpperCase())).join(" to ") : event.text;
  element.replaceChildren(time, level, asSentence(`${event.name}: ${text}`));
}

let sound = null;
function beep() {
  sound ??= new AudioContext();
  const tone = new OscillatorNode(sound, { frequency: 880 });
  tone.connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + 0.15);
}

export function startEvents(live) {
  const strip = document.getElementById("event");
  const list = document.getElementById("events");
  let shown = 0;

  const refresh = async () => {
    try {
      const events = await get("/api/events");
      forgetErrors("events");
      list.replaceChildren(...events.reverse().map((event) => {
        const row = document.createElement("li");
        fill(row, event);
        return row;
      }));
    } catch (error) {
      showError(`The list of events is not up to date: ${error.message}`, "", "events");
    }
  };

  live.onView((view) => {
    if (view.event === null || view.event.number === shown) return;
    shown = view.event.number;
    fill(strip, view.event);
    if (view.event.name === "countdown") beep();
    if (!list.hidden) refresh();
  });
  const open = (wanted) => {
    list.hidden = !wanted;
    strip.setAttribute("aria-expanded", String(wanted));
    if (wanted) refresh();
  };
  strip.addEventListener("click", () => open(list.hidden));
  window.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !list.hidden) open(false);
  });
}
