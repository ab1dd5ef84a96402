// The form of a sweep: how many trials it is as it is typed, and what is wrong with it at the field that is wrong.

import { post } from "./api.js";
import { LOOKS } from "./scope.js";

const WAIT_MS = 250;
const LISTS = ["controllers", "objects"];

export class SweepForm {
  constructor(form) {
    this.form = form;
    this.wrong = form.querySelector(".wrong");
    this.refusal = null; // why what is typed cannot be added
    this.size = null;
    this.asked = 0;
    form.addEventListener("input", () => this.changed());
  }

  order() {
    const order = {};
    for (const { name, type, value } of this.form.elements) if (name && type !== "checkbox") order[name] = value;
    for (const name of LISTS) order[name] = [...this.form.querySelectorAll(`[name="${name}"]:checked`)].map((box) => box.value);
    return order;
  }

  changed() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.measure(), WAIT_MS);
  }

  async measure() {
    const asked = ++this.asked;
    const order = this.order();
    if (LOOKS || !order.reference) return;
    const empty = LISTS.find((name) => order[name].length === 0);
    if (empty) return this.refuse(`${empty}: tick one at least`);
    try {
      const size = await post("/api/queue/sweep/size", order);
      if (asked !== this.asked) return;
      this.size = size;
      if (size.trials > size.room) this.refuse(`These are ${size.trials} trials, and the queue has room for ${size.room} more.`);
      else this.refuse(null);
    } catch (error) {
      if (asked === this.asked) this.refuse(error.message);
    }
  }

  // what: one line, "field: why" where it is about a field.
  refuse(what) {
    this.refusal = what;
    const field = what === null ? null : this.form.querySelector(`[data-field="${what.split(":")[0].split(".")[0]}"]`);
    for (const element of this.form.querySelectorAll("[data-field]")) {
      const input = element.querySelector("input:not([type=checkbox])");
      input?.setAttribute("aria-invalid", String(element === field));
      element.classList.toggle("invalid", element === field);
    }
    this.wrong.hidden = what === null;
    const text = field ? what.slice(what.indexOf(":") + 2) : what ?? "";
    if (this.wrong.textContent !== text) this.wrong.textContent = text;
    if (field?.closest("details")) field.closest("details").open = true;
    if (field) field.after(this.wrong);
    else this.form.querySelector(".fields").append(this.wrong);
  }

  // How many trials it is, in words.
  get words() {
    if (this.size === null || this.refusal !== null) return "";
    return this.size.trials === 1 ? "1 trial" : `${this.size.trials} trials, one after the other`;
  }
}
