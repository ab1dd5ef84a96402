// What a trial may follow, as a choice: accepted recordings and plans, the newest first.

import { get } from "./api.js";
import { showError } from "./errors.js";
import { plain, when } from "./formats.js";

// Of today: the time is enough to tell recordings apart.
export function shortWhen(seconds) {
  const [day, time] = when(seconds).split(" ");
  return day === when(Date.now() / 1000).split(" ")[0] ? time : `${day} ${time.slice(0, 5)}`;
}

const text = (log) => `${log.kind === "plan" ? "plan: " : ""}${log.title || plain(log.object)}, ${shortWhen(log.when)}`;

export class References {
  // fields: for the object; propose: is given the object that the chosen reference was made with.
  constructor(form, fields, propose) {
    this.select = form.elements.reference;
    this.fields = fields;
    this.propose = propose;
    this.count = 0;
    this.logs = [];
    this.select.addEventListener("change", () => this.proposeObject());
  }

  // What the reference was made with: a person may choose another one afterwards.
  proposeObject() {
    const object = this.logs.find((log) => log.id === this.select.value)?.object;
    if (object) this.propose(object);
  }

  // wanted: the id of what is chosen now, where it is there.
  async refresh(wanted = null) {
    try {
      this.logs = (await get("/api/logs")).filter((log) => log.recording);
    } catch (error) {
      showError(`The list of references is not up to date: ${error.message}`);
      return;
    }
    const first = this.select.options.length === 1 && this.select.value === "";
    const before = this.select.value || this.select.dataset.remembered;
    const chosen = wanted ?? before;
    this.count = this.logs.length;
    this.select.replaceChildren(...this.logs.map((log) => new Option(text(log), log.id)));
    if (this.count === 0) this.select.add(new Option("no recording yet", ""));
    else if (this.logs.some((log) => log.id === chosen)) this.select.value = chosen;
    // the object that was chosen the last time stays
    if (this.select.value !== before && !(first && this.fields.some((field) => field.dataset.remembered))) this.proposeObject();
  }
}
