// Other logs in the same panes, aligned at the first impact or at the start, and what was set differently.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { plain, when } from "../formats.js";
import { Log } from "./source.js";
import { MOST_OTHERS } from "./view.js";

const HALF_SAMPLE_S = 0.0005;
const NOT_SET = "not set";

export class Compare {
  constructor(view, log, plots) {
    Object.assign(this, { view, log, plots });
    this.select = document.getElementById("other");
    this.align = document.getElementById("align");
    this.align.value = view.align;
    this.chips = document.getElementById("overlays");
    this.panel = document.getElementById("difference");
    this.ghost = document.getElementById("ghost");
    this.names = new Map();
    this.read = new Map(); // the logs by id, once something of them has been read
    this.set = new Map(); // what was set differently, by id: Map of key to {this, other}
    this.select.addEventListener("change", () => {
      const id = this.select.value;
      this.select.value = "";
      if (id) this.add(id);
    });
    this.align.addEventListener("change", () => {
      view.align = this.align.value;
      this.place();
    });
    for (const what of ["reference", "minus"]) {
      const [box, name] = [document.getElementById(what), what === "minus" ? "difference" : what];
      box.checked = view[name];
      box.addEventListener("change", () => view.show(name, box.checked));
    }
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
    const wanted = this.view.others;
    this.view.others = [];
    for (const id of wanted) this.add(id);
    this.show();
  }

  async add(id) {
    if (this.view.others.includes(id)) return;
    if (this.view.others.length === MOST_OTHERS) {
      showError(`${MOST_OTHERS} logs over this one are the most: take one away first.`);
      return;
    }
    this.view.others = [...this.view.others, id];
    this.show();
    const other = new Log(id);
    try {
      const part = () => {
        if (!this.view.others.includes(id)) return;
        this.read.set(id, other);
        this.place();
      };
      await Promise.all([other.read(part), this.learnDifference(id)]);
    } catch (error) {
      showError(`Not compared: ${error.message}`);
    }
  }

  remove(id) {
    this.view.others = this.view.others.filter((other) => other !== id);
    for (const known of [this.read, this.set]) known.delete(id);
    this.place();
    this.showDifference();
  }

  // Move the other logs' times so that the first impacts, or the first samples, are one below the other.
  place() {
    const others = this.view.others.map((id) => this.read.get(id)).filter(Boolean);
    const atImpact = (other) => this.view.align === "impact" && this.log.impact !== null && other.impact !== null;
    const lacking = this.log.impact === null || others.some((other) => other.impact === null);
    this.align.options[0].textContent = others.length && lacking ? "impact, or start" : "impact";
    this.align.title = others.length && lacking ? "A log without an impact is aligned at the start" : "";
    this.plots.others = others.map((log) => ({ log, offset: atImpact(log) ? this.log.impact - log.impact : 0 }));
    this.show();
    this.view.tell("other");
    this.plots.refresh();
  }

  // A chip for each log that lies over this one, in its colour; pressed, it goes.
  show() {
    const none = this.view.others.length === 0;
    this.align.disabled = none;
    document.getElementById("minus").disabled = none;
    this.chips.replaceChildren(...this.view.others.map((id, place) => {
      const chip = document.createElement("button");
      chip.type = "button";
      chip.className = "chip";
      chip.dataset.place = place + 1;
      chip.title = `Take ${this.nameOf(id)} away`;
      chip.textContent = this.nameOf(id);
      chip.addEventListener("click", () => this.remove(id));
      return chip;
    }));
    if (none) this.panel.hidden = true;
  }

  nameOf(id) {
    return this.names.get(id) ?? "the other log";
  }

  // Say what the ghost shows at the cursor, in the first other log's own time, and return its values there: null without
  // one, none before its first sample, when there is no ghost, nor after its last one, where the ghost stands still.
  showGhost({ t, ghost_t: shown, ghost_values: values }) {
    const [other] = this.plots.others;
    this.ghost.hidden = shown === undefined || !other;
    if (this.ghost.hidden) return null;
    const { duration_s: end, done } = other.log.document;
    const [before, after] = [t - other.offset < -HALF_SAMPLE_S, t - other.offset > end + HALF_SAMPLE_S];
    const word = before ? "has not begun" : !after ? `at ${shown.toFixed(3)} s` : `${done ? "ended at" : "has been read up to"} ${end.toFixed(3)} s`;
    this.ghost.querySelector(".name").textContent = this.nameOf(other.log.id);
    this.ghost.querySelector(".at").textContent = word;
    return before || after ? {} : values;
  }

  async learnDifference(id) {
    const rows = await get(`/api/logs/${this.log.id}/difference?other=${id}`);
    if (!this.view.others.includes(id)) return;
    this.set.set(id, new Map(rows.map((row) => [row.key, row])));
    this.showDifference();
  }

  // A row for each setting that one of the logs has otherwise, a column for each log.
  showDifference() {
    const ids = this.view.others.filter((id) => this.set.has(id));
    const keys = [...new Set(ids.flatMap((id) => [...this.set.get(id).keys()]))];
    const head = this.panel.querySelector("thead tr");
    head.replaceChildren(...["", "this log", ...ids.map((id) => this.nameOf(id))].map((text) => {
      const cell = document.createElement("th");
      cell.scope = "col";
      cell.textContent = text;
      return cell;
    }));
    this.panel.querySelector("tbody").replaceChildren(...keys.map((key) => this.row(key, ids)));
    document.getElementById("difference-count").textContent = keys.length ? `${keys.length}` : "nothing";
    this.panel.querySelector("table").hidden = keys.length === 0;
    this.panel.hidden = ids.length === 0;
  }

  row(key, ids) {
    const row = document.createElement("tr");
    const name = row.insertCell();
    const dot = key.lastIndexOf(".");
    const [where, word] = [document.createElement("small"), document.createElement("b")];
    where.textContent = key.slice(0, dot + 1);
    word.textContent = key.slice(dot + 1);
    name.append(where, word);
    const found = ids.map((id) => this.set.get(id).get(key));
    const own = found.find(Boolean).this ?? NOT_SET;
    for (const text of [own, ...found.map((difference) => (difference ? difference.other ?? NOT_SET : own))]) {
      const cell = row.insertCell();
      cell.textContent = text;
      cell.classList.toggle("same", text === own);
    }
    return row;
  }
}
