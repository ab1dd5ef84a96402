// The trial's form in the scene: where the object is put and which way the pads go, before anything moves.

import { post } from "./api.js";
import { numberOf } from "./numbers.js";
import { LOOKS } from "./scope.js";

const WAIT_MS = 150;
const FIELDS = ["displacement_mm", "displacement_x_mm", "yaw_deg"];

export class Plan {
  constructor(form, live) {
    this.form = form;
    this.said = null;
    this.allowed = false;
    this.timer = null;
    this.sending = false;
    for (const name of ["input", "change"]) form.addEventListener(name, () => this.tell());
    new MutationObserver(() => this.tell()).observe(form, { attributeFilter: ["hidden"] });
    new MutationObserver(() => this.tell()).observe(form.elements.reference, { childList: true });
    live.onView(({ status, you, unreachable }) => {
      const allowed = !LOOKS && !unreachable && status !== null && (status.holder === null || status.holder === you);
      if (allowed && !this.allowed) this.said = null; // another operator's may be shown
      this.allowed = allowed;
      if (allowed && this.said === null && this.timer === null) this.tell(); // put off by every view it was never sent
    });
  }

  get words() {
    const { form } = this;
    if (form.hidden) return {};
    const plan = { object: form.elements.object.value, reference: form.elements.reference.value };
    for (const name of FIELDS) plan[name] = numberOf(form.elements[name]) || 0;
    return plan;
  }

  tell() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.timer = null;
      this.send();
    }, WAIT_MS);
  }

  async send() {
    const words = JSON.stringify(this.words);
    if (this.sending || !this.allowed || words === this.said) return;
    this.said = words;
    this.sending = true; // one at a time: of two on their way the first might come last, and stay
    try {
      const { drawn } = await post("/api/scene/plan", JSON.parse(words));
      if (!drawn) this.said = null;
    } catch {
      this.said = null; // drawn with the next view, or by the operator who has control
    }
    this.sending = false;
    if (this.said !== null) this.send(); // what has changed meanwhile
  }
}
