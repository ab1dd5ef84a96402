// The longest stalls of a log whose arms had clocks of their own: whose lateness, how long, what the host did.

import { get } from "../api.js";

const us = (value) => `${Math.round(value)} us`;

export async function showLateness(log, view) {
  const { lateness } = await get(`/api/logs/${log.id}/lateness`);
  document.getElementById("lateness").hidden = lateness === null;
  document.getElementById("lateness").dataset.known = "true";
  if (lateness === null) return;
  document.getElementById("lateness-line").textContent = lateness.late ? `${lateness.late} of ${lateness.turns} turns, ${lateness.stalls} stalls` : "none";
  document.getElementById("lateness-line").title = lateness.line;
  document.getElementById("late-turns").replaceChildren(...lateness.worst.map((turn) => {
    const [row, button] = [document.createElement("li"), document.createElement("button")];
    button.type = "button";
    const parts = [`outside ${us(turn.outside_us)}`, `turn before ${us(turn.busy_us)}`, `waking ${us(turn.wake_us)}`, `socket ${us(turn.read_us)}`, `tick ${us(turn.tick_us)}`];
    const text = `${turn.side}, ${(turn.late_us / 1000).toFixed(1)} ms${turn.cause ? `, ${turn.cause}` : ""}: ${parts.join(", ")}`;
    for (const [name, word] of [["at", `${turn.t_s.toFixed(3)} s`], ["level", turn.blame], ["", text]]) {
      const part = document.createElement("span");
      part.className = name;
      part.textContent = word;
      button.append(part);
    }
    button.addEventListener("click", () => view.setCursor(turn.t_s));
    row.append(button);
    return row;
  }));
}
