// The bottom strip: the last event, and behind it the list of the newest ones.

import { get } from "./api.js";
import { showError } from "./errors.js";

function fill(element, event) {
  const time = document.createElement("time");
  time.textContent = new Date(event.seen_s * 1000).toTimeString().slice(0, 8);
  const robot = document.createElement("time");
  robot.textContent = `t = ${event.t_s.toFixed(3)} s`;
  robot.title = "Robot's time, as in the log";
  const level = document.createElement("span");
  level.className = "level";
  level.dataset.level = event.level;
  level.textContent = event.level;
  element.replaceChildren(time, robot, level, `${event.name}: ${event.text}`);
}

export function startEvents(live) {
  const strip = document.getElementById("event");
  const list = document.getElementById("events");
  let shown = 0;

  const refresh = async () => {
    try {
      const events = await get("/api/events");
      list.replaceChildren(...events.reverse().map((event) => {
        const row = document.createElement("li");
        fill(row, event);
        return row;
      }));
    } catch (error) {
      showError(`The list of events is not up to date: ${error.message}`);
    }
  };

  live.onView((view) => {
    if (view.event === null || view.event.number === shown) return;
    shown = view.event.number;
    fill(strip, view.event);
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
