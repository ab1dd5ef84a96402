// The form of a sweep: how many trials it is as it is typed, and what is wrong with it at the field that is wrong.

import { post } from "./api.js";
import { showRefusal, valuesOf } from "./field_refusal.js";
import { LOOKS } from "./scope.js";

const WAIT_MS = 250;
const LISTS = ["controllers", "objects"];

export class SweepForm {
  constructor(form) {
    this.form = form;
    this.wrong = false; // what is typed cannot be added
    this.size = null;
    this.asked = 0;
    form.addEventListener("input", () => this.changed());
  }

  order() {
    return valuesOf(this.form, LISTS);
  }

  changed() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.measure(), WAIT_MS);
  }

  async measure() {
    const asked = ++this.asked;
    const order = this.order();
    if (LOOKS || !order.reference) return;
    if (Object.values(order).some(Number.isNaN)) return this.refuse(null, true); // its sentence stands at its field
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

  // what: as from the server, null for none; wrong: whether a number is refused at its field.
  refuse(what, wrong = what !== null) {
    this.wrong = wrong;
    showRefusal(this.form, what);
  }

  // How many trials it is, in words.
  get words() {
    if (this.size === null || this.wrong) return "";
    return this.size.trials === 1 ? "1 trial" : `${this.size.trials} trials, one after the other`;
  }
}
