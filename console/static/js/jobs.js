// Orders and the running job: forms that say why they cannot act, and one progress bar.

import { post } from "./api.js";
import { whyNot } from "./control.js";
import { showError } from "./errors.js";
import { stop } from "./stop.js";

const ACTIVE = new Set(["starting", "running", "stopping"]);
const WHAT = { demonstration: "Demonstration", trial: "Trial", teleoperation: "Teleoperation" };

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

function bodyOf(form) {
  const body = {};
  for (const field of form.elements) {
    if (!field.name) continue;
    body[field.name] = field.type === "number" ? field.valueAsNumber : field.value;
  }
  return body;
}

function sentence(job) {
  const what = `${WHAT[job.kind]} ${job.number} (${job.title})`;
  switch (job.state) {
    case "starting": return [`${what} is being prepared.`, ""];
    case "running": return [`${what} runs.`, ""];
    case "stopping": return [`${what} is being stopped.`, ""];
    case "stopped": return [`${what} was stopped: ${job.reason ?? "by the operator"}.`, "bad"];
    case "failed": return [`${what} failed: ${job.reason}.`, "bad"];
    default:
      if (job.success) return [`${what} succeeded.`, "good"];
      return [`${what} ended without success: ${job.reason}.`, "bad"];
  }
}

export class Jobs {
  constructor(live, onFinished) {
    this.onFinished = onFinished;
    this.recordings = 0;
    this.lastState = null;
    this.forms = ["demonstration", "trial"].map((name) => document.getElementById(name));
    for (const form of this.forms) form.addEventListener("submit", (event) => this.order(event, form));
    document.getElementById("cancel").addEventListener("click", stop);
    live.onView((view) => this.show(view));
    this.showWhy("the console has not heard from the robot yet");
  }

  async order(event, form) {
    event.preventDefault();
    const button = form.querySelector("button[type=submit]");
    button.disabled = true;
    try {
      await post(`/api/jobs/${form.id}`, bodyOf(form));
    } catch (error) {
      showError(`${WHAT[form.id]} not started: ${error.message}. The robot stays as it is.`);
    }
  }

  setRecordings(count) {
    this.recordings = count;
  }

  showWhy(refusal) {
    for (const form of this.forms) {
      const missing = form.id === "trial" && this.recordings === 0 ? "record a demonstration first: a trial follows one" : null;
      const why = refusal ?? missing;
      const button = form.querySelector("button[type=submit]");
      button.disabled = why !== null;
      button.title = why ?? "";
      write(form.querySelector("[data-why]"), why ?? "");
    }
  }

  show(view) {
    this.showWhy(whyNot(view));
    if (view.status?.job) this.showJob(view.status.job);
  }

  showJob(job) {
    const [text, tone] = sentence(job);
    const line = document.getElementById("job-line");
    write(line, text);
    line.dataset.tone = tone;
    const active = ACTIVE.has(job.state);
    document.getElementById("progress-row").hidden = !active || job.kind === "teleoperation"; // it has no length
    document.getElementById("progress").value = job.progress;
    write(document.getElementById("progress-text"), `${Math.round(job.progress * 100)} %`);
    const state = `${job.number} ${job.state}`;
    if (this.lastState !== null && this.lastState !== state && !active) {
      this.onFinished();
      if (job.state === "failed") showError(`${text} Both arms are stopped; mend the cause and order it again.`);
    }
    this.lastState = state;
  }
}
