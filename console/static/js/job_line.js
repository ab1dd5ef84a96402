// The running job, its progress, and a way to end it; then what became of it: a trial in a card, others in a sentence.

import { REAL, TWO } from "./arms.js";
import { named } from "./formats.js";
import { moveFocus } from "./keyboard.js";
import { Outcome } from "./outcome.js";
import { stop } from "./stop.js";
import { TrialCard } from "./trial_card.js";

const ACTIVE = new Set(["starting", "running", "stopping"]);
export const WHAT = { demonstration: "Demonstration", trial: "Trial", teleoperation: "Teleoperation", playback: "Playback", move: "Motion", guide: "Guiding" };

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

// What a job does, or how it has ended and why, and the tone of it. word: of the cell's state.
export function sentence(job, word) {
  const what = `${WHAT[job.kind]} ${job.number} (${named(job.title)})`;
  const reason = named(job.reason ?? "no reason given").replace(/\.$/, "");
  switch (job.state) {
    case "starting": return [`${what} is being prepared.`, ""];
    case "running":
      if (REAL && job.kind !== "teleoperation" && !job.title.endsWith(", shadow")) return [`${what}: hold C, or another clutch. Let it go, and ${TWO ? "both arms stop" : "the arm stops"}.`, ""];
      return [word === "preparing" ? `${what} is being prepared.` : `${what} runs.`, ""];
    case "stopping": return [`${what} is being stopped.`, ""];
    case "stopped": return [`${what} was stopped: ${job.reason ? reason : "by the operator"}.`, "bad"];
    case "failed": return [`${what} failed: ${reason}.`, "bad"];
    default:
      if (!job.success) return [`${what} ended without success: ${reason}.`, "bad"];
      return job.kind === "trial" ? [`${what} has ended.`, ""] : [`${what} succeeded.`, "good"]; // its card knows more
  }
}

// onFinished is called when a job that was seen running has ended, follow with the id of a log that a trial is to follow.
export function startJobLine(live, onFinished, follow = null) {
  const line = document.getElementById("job-line");
  const card = TWO ? new TrialCard(live) : null; // of a grab
  new Outcome(live, onFinished, follow);
  let last = null;
  const cancel = document.getElementById("cancel");
  cancel.addEventListener("click", stop);
  let ordered = null; // the button that was pressed by keys: while its job is active it is disabled, and Cancel has the focus
  window.addEventListener("submit", ({ target, submitter }) => {
    ordered = target.matches("[data-moves][role=tabpanel]") && submitter?.matches(":focus-visible") ? submitter : null;
  }, true);
  window.addEventListener("pointerdown", () => (ordered = null), true);
  const keepFocus = (active) => {
    const [at, next] = [document.activeElement, active ? cancel : ordered];
    if (![document.body, cancel, ordered].includes(at)) ordered = null;
    else if (at !== next && !next.disabled && next.checkVisibility()) moveFocus(next);
  };
  live.onView(({ status, state: { word } }) => {
    const job = status?.job;
    const fault = status?.phase === "fault" && !(job?.reason ?? "").includes(status.reason ?? ""); // of no job
    const [text, tone] = fault ? [`Fault: ${named(status.reason).replace(/\.$/, "")}.`, "bad"] : job ? sentence(job, word) : [line.textContent, ""];
    write(line, text);
    line.dataset.tone = tone;
    if (!job) return;
    const active = ACTIVE.has(job.state);
    const preparing = job.state === "starting" || (active && text.endsWith(" is being prepared."));
    document.getElementById("progress-row").hidden = !active || (!preparing && ["teleoperation", "guide"].includes(job.kind)); // they have no length
    document.getElementById("spinner").hidden = !preparing;
    document.getElementById("progress").value = job.progress;
    write(document.getElementById("progress-text"), `${Math.round(job.progress * 100)} %`);
    if (job.kind === "trial" && !active && job.log !== null) card?.show(job.log);
    else if (job.kind === "trial" && active) card?.wait();
    else card?.hide();
    if (ordered) keepFocus(active);
    const state = `${job.number} ${job.state}`;
    if (last !== null && last !== state && !active) onFinished();
    last = state;
  });
}
