// A second log in the same panes, aligned at the first impact or at the start, and what was set differently.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { plain, when } from "../formats.js";
import { Log } from "./source.js";

const HALF_SAMPLE_S = 0.0005;

export class Compare {
  constructor(view, log, plots) {
    Object.assign(this, { view, log, plots });
    this.select = document.getElementById("other");
    this.align = document.getElementById("align");
    this.align.value = view.align;
    this.panel = document.getElementById("difference");
    this.ghost = document.getElementById("ghost");
    this.select.addEventListener("change", () => this.choose(this.select.value));
    this.align.addEventListener("change", () => {
      view.align = this.align.value;
      this.place();
    });
  }

  async offer() {
    try {
      const rows = (await get("/api/logs")).filter((row) => row.id !== this.log.id && row.kind !== "not ours");
      const title = (row) => [row.name, plain(row.controller), row.displacement_mm === null ? "" : `${row.displacement_mm} mm`, when(row.when).slice(5, 16)].filter(Boolean).join(", ");
      this.select.append(...rows.map((row) => new Option(title(row), row.id)));
      this.names = new Map(rows.map((row) => [row.id, row.name]));
    } catch (error) {
      showError(`The logs to compare with are not known: ${error.message}`);
    }
    if (this.view.other) this.choose(this.view.other);
  }

  async choose(id) {
    this.view.other = id;
    this.select.value = id;
    this.align.disabled = id === "";
    this.align.title = id === "" ? "Choose a log to compare with first" : "";
    this.align.options[0].textContent = "impact";
    this.panel.hidden = true;
    this.plots.other = null;
    if (id === "") {
      this.view.tell("other");
      this.plots.refresh();
      return;
    }
    const other = new Log(id);
    try {
      await Promise.all([other.read(() => this.view.other === id && this.place(other)), this.showDifference(id)]);
    } catch (error) {
      showError(`Not compared: ${error.message}`);
    }
  }

  // Move the other log's time so that both first impacts, or both first samples, are one below the other.
  place(other = this.plots.other?.log) {
    if (!other) return;
    const impacts = [this.log.impact, other.impact];
    const atImpact = this.view.align === "impact" && !impacts.includes(null);
    this.align.options[0].textContent = impacts.includes(null) ? "impact (one log has none: start)" : "impact";
    this.plots.other = { log: other, offset: atImpact ? impacts[0] - impacts[1] : 0 };
    this.view.tell("other");
    this.plots.refresh();
  }

  get name() {
    return this.names?.get(this.view.other) ?? "the other log";
  }

  // In words, for a picture: which log is drawn dash-dotted, and how it is aligned.
  get said() {
    return this.plots.other ? `dash-dotted: ${this.name}, moved by ${this.plots.other.offset.toFixed(3)} s` : "";
  }

  // Say what the ghost shows at the cursor, in the other log's own time, and return its values there: null without
  // another log, none before its first sample, when there is no ghost, nor after its last one, where the ghost stands still.
  showGhost({ t, ghost_t: shown, ghost_values: values }) {
    const { other } = this.plots;
    this.ghost.hidden = shown === undefined || other === null;
    if (this.ghost.hidden) return null;
    const { duration_s: end, done } = other.log.document;
    const [before, after] = [t - other.offset < -HALF_SAMPLE_S, t - other.offset > end + HALF_SAMPLE_S];
    const word = before ? "has not begun" : !after ? `at ${shown.toFixed(3)} s` : `${done ? "ended at" : "has been read up to"} ${end.toFixed(3)} s`;
    this.ghost.querySelector(".name").textContent = this.name;
    this.ghost.querySelector(".at").textContent = word;
    return before || after ? {} : values;
  }

  async showDifference(id) {
    const rows = await get(`/api/logs/${this.log.id}/difference?other=${id}`);
    if (this.view.other !== id) return;
    const body = this.panel.querySelector("tbody");
    body.replaceChildren();
    for (const { key, this: ours, other } of rows) {
      const row = body.insertRow();
      row.insertCell().append(...key.split(/(?<=\.)/).flatMap((part) => [part, document.createElement("wbr")]));
      for (const text of [ours ?? "not set", other ?? "not set"]) row.insertCell().textContent = text;
    }
    document.getElementById("other-name").textContent = this.names?.get(id) ?? "other";
    this.panel.querySelector("table").hidden = rows.length === 0;
    this.panel.querySelector(".empty").hidden = rows.length > 0;
    this.panel.hidden = false;
  }
}
