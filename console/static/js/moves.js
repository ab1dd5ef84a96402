// Buttons for motions of arms that stand anywhere: go to the start, put down what is held, open.

import { post } from "./api.js";
import { UNCHANGED } from "./arms.js";
import { whyNot } from "./control.js";
import { showError } from "./errors.js";

export function startMoves(bar, live) {
  const buttons = [...bar.querySelectorAll("button[data-motion]")];
  for (const button of buttons) {
    button.dataset.what = button.title;
    button.addEventListener("click", async () => {
      button.disabled = true;
      try {
        await post("/api/jobs/move", { motion: button.dataset.motion });
      } catch (error) {
        showError(`${button.textContent}: not begun: ${error.message}. ${UNCHANGED}`);
      }
    });
  }
  live.onView((view) => {
    const why = whyNot(view);
    for (const button of buttons) {
      button.disabled = why !== null;
      button.title = why ?? button.dataset.what;
    }
  });
}
