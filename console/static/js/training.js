// Training: a fault of the simulated arms at a random moment, and what the operator did about it.

import { get, post } from "./api.js";
import { whyNot } from "./control.js";
import { showError } from "./errors.js";
import { bodyOf, showWhy } from "./jobs.js";

const LOOK_MS = 400;
const $ = (id) => document.getElementById(id);

export async function startTraining(form, live) {
  let timer = null;
  let faulty = false; // as the live view says, before the exercise does

  const show = ({ faults, exercise }) => {
    const { fault } = form.elements;
    if (fault.options.length === 1) fault.append(...Object.entries(faults).map(([name, words]) => new Option(words, name)));
    $("exercise").hidden = exercise === null;
    if (exercise === null) return;
    const over = exercise.stage === "over";
    const waiting = exercise.stage === "waiting" && !faulty ? "It has not come yet." : "Something is wrong. What do you do?";
    $("exercise-verdict").textContent = over ? `${exercise.verdict[0].toUpperCase()}${exercise.verdict.slice(1)}.` : waiting;
    $("exercise-verdict").dataset.tone = over ? (exercise.right ? "good" : "bad") : "";
    $("exercise-fault").textContent = exercise.fault || "a surprise";
    $("exercise-did").textContent = !over ? "-" : exercise.did ?? "nothing";
    $("exercise-todo").textContent = exercise.todo || "-";
    $("exercise-row").parentElement.hidden = exercise.row === "";
    $("exercise-row").href = `/recovery#${exercise.row}`;
    clearTimeout(timer);
    if (!over) timer = setTimeout(look, LOOK_MS);
  };

  const look = async () => {
    try {
      show(await get("/api/training"));
    } catch {
      timer = setTimeout(look, LOOK_MS);
    }
  };

  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    form.querySelector("button[type=submit]").disabled = true;
    try {
      show(await post("/api/training", bodyOf(form)));
    } catch (error) {
      showError(`Training not begun: ${error.message}. The robot stays as it is.`);
    }
  });
  live.onView((view) => {
    faulty = view.status?.phase === "fault";
    showWhy(form, whyNot(view));
  });
  look();
}
