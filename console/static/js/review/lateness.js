// The longest stalls of a log whose arms had clocks of their own: whose lateness, how long, what the host did.

import { get } from "../api.js";

const us = (value) => `${Math.round(value)} us`;

export async function showLateness(log, view) {
  const { lateness } = await get(`/api/logs/${log.id}/lateness`);
  document.getElementById("lateness").hidden = lateness === null;
  document.getElementById("lateness").dataset.known = "true";
  if (lateness === null) return;
  const shares = Object.entries(lateness.shares).map(([whose, count]) => `${count} ${whose}`).join(", ");
  document.getElementById("lateness-line").textContent = lateness.late ? `${shares}; ${lateness.cycles} cycles` : "none";
  document.getElementById("lateness-line").title = lateness.line;
  document.getElementById("late-cycles").replaceChildren(...lateness.worst.map((cycle) => {
    const [row, button] = [document.createElement("li"), document.createElement("button")];
    button.type = "button";
    const parts = [`outside ${us(cycle.outside_us)}`, `cycle before ${us(cycle.busy_us)}`, `waking ${us(cycle.wake_us)}`, `socket ${us(cycle.read_us)}`, `tick ${us(cycle.tick_us)}`];
    const text = `${cycle.side} arm, ${(cycle.late_us / 1000).toFixed(1)} ms${cycle.cause ? `, ${cycle.cause}` : ""}: ${parts.join(", ")}`;
    for (const [name, word] of [["at", `${cycle.t_s.toFixed(3)} s`], ["level", cycle.blame], ["", text]]) {
      const part = document.createElement("span");
      part.className = name;
      part.textContent = word;
      button.append(part);
    }
    button.addEventListener("click", () => view.setCursor(cycle.t_s));
    row.append(button);
    return row;
  }));
}
