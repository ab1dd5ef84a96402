// Orders: forms that say why they cannot act.

import { post } from "./api.js";
import { whyNoRun } from "./control.js";
import { showError } from "./errors.js";
import { valueOf } from "./field_refusal.js";
import { WHAT } from "./job_line.js";

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

export function bodyOf(form) {
  const body = {};
  for (const field of form.elements) {
    if (!field.name) continue;
    body[field.name] = valueOf(field);
  }
  return body;
}

// Why a form cannot be sent, beside its button; null where it can: then what it would do, if there are words for it.
export function showWhy(form, why, otherwise = "") {
  const button = form.querySelector("button[type=submit]");
  button.disabled = why !== null;
  button.title = why ?? "";
  write(form.querySelector("[data-why]"), why ?? otherwise);
}

export class Jobs {
  constructor(live, references) {
    this.references = references;
    this.forms = ["demonstration", "trial"].map((name) => document.getElementById(name));
    for (const form of this.forms) form.addEventListener("submit", (event) => this.order(event, form));
    live.onView((view) => this.show(whyNoRun(view)));
    this.show("the console has not heard from the robot yet");
  }

  async order(event, form) {
    event.preventDefault();
    form.querySelector("button[type=submit]").disabled = true;
    try {
      await post(`/api/jobs/${form.id}`, bodyOf(form));
    } catch (error) {
      showError(`${WHAT[form.id]} not started: ${error.message}. The robot stays as it is.`);
    }
  }

  show(refusal) {
    for (const form of this.forms) {
      const missing = form.id === "trial" && this.references.count === 0 ? "record a demonstration first: a trial follows one" : null;
      showWhy(form, refusal ?? missing);
    }
  }
}
