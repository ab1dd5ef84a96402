// Other logs in the same panes, aligned at the first impact or at the start, and what was set differently.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { plain, when } from "../formats.js";
import { Log } from "./source.js";
import { overlaySwatch } from "./style.js";
import { MOST_OTHERS } from "./view.js";

const HALF_SAMPLE_S = 0.0005;
const NOT_SET = "not set";
const NAME = /^[a-z]+(_[a-z]+)*$/; // and no file, number or commit
// of a row of the list of logs: what tells two apart, as it is written
const TELLING = {
  kind: plain, object: plain, controller: plain, displacement_mm: (mm) => `${mm > 0 ? "+" : ""}${mm} mm`, displacement_x_mm: (mm) => `x ${mm} mm`,
  yaw_deg: (degrees) => `${degrees}\u00b0`, law_inertia: plain,
};

// A log as what it has otherwise than this one.
function nameOf(row, own) {
  const words = Object.entries(TELLING).filter(([key]) => row[key] !== own[key] && row[key] !== null).map(([key, written]) => written(row[key]));
  if (words.length === 0 && row.seed !== own.seed && row.seed !== null) words.push(`seed ${row.seed}`);
  return words.length ? words.join(", ") : `as this one, ${when(row.when).slice(5, 16)}`;
}

export class Compare {
  constructor(view, log, plots) {
    Object.assign(this, { view, log, plots });
    this.select = document.getElementById("other");
    this.align = document.getElementById("align");
    this.align.value = view.align;
    this.chips = document.getElementById("overlays");
    this.ghost = document.getElementById("ghost");
    this.names = new Map(); // {name, file} of each log that can be compared, by its id
    this.read = new Map(); // the logs by id, once something of them has been read
    this.set = new Map(); // what was set differently, by id: [{key, this, other}]
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
      const rows = (await get("/api/logs")).filter((row) => row.kind !== "not ours");
      const own = rows.find((row) => row.id === this.log.id) ?? {};
      const others = rows.filter((row) => row !== own);
      this.names = new Map(others.map((row) => [row.id, { name: nameOf(row, own), file: row.name, began: when(row.when).slice(11) }]));
      this.select.append(...others.map((row) => new Option(`${nameOf(row, own)}, ${when(row.when).slice(5, 16)} (${row.name})`, row.id)));
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
  }

  // Move the other logs' times so that the first impacts, or the first samples, are one below the other.
  place() {
    const others = this.view.others.map((id) => this.read.get(id)).filter(Boolean);
    const atImpact = (other) => this.view.align === "impact" && this.log.impact !== null && other.impact !== null;
    const lacking = this.log.impact === null || others.some((other) => other.impact === null);
    this.align.options[0].textContent = others.length && lacking ? "impact, or start" : "impact";
    this.align.title = others.length && lacking ? "A log without an impact is aligned at the start" : "";
    this.plots.others = others.map((log) => ({ log, place: this.view.others.indexOf(log.id), offset: atImpact(log) ? this.log.impact - log.impact : 0 }));
    this.show();
    if (!this.view.placed && this.view.t === 0 && others.some(atImpact)) this.view.setCursor(this.log.impact); // at 0 another log may not have begun
    this.view.tell("other");
    this.plots.refresh();
  }

  // A chip for each log that lies over this one, as its curves look; pressed, it says what was set differently.
  show() {
    const none = this.view.others.length === 0;
    document.getElementById("comparing").hidden = none;
    this.chips.hidden = none;
    const opened = this.chips.querySelector("details[open]")?.dataset.id;
    this.chips.replaceChildren(...this.view.others.map((id, place) => this.chip(id, place, id === opened)));
  }

  chip(id, place, open) {
    const chip = Object.assign(document.createElement("span"), { className: "chip" });
    const menu = Object.assign(document.createElement("details"), { className: "menu", open });
    menu.dataset.id = id;
    const summary = document.createElement("summary");
    summary.title = `${this.nameOf(id)} (${this.fileOf(id)})`;
    summary.append(overlaySwatch(place), Object.assign(document.createElement("span"), { className: "name", textContent: this.nameOf(id) }));
    menu.append(summary, this.difference(id));
    const away = Object.assign(document.createElement("button"), { type: "button", textContent: "\u00d7", title: `Take ${this.nameOf(id)} away` });
    away.ariaLabel = away.title;
    away.addEventListener("click", () => this.remove(id));
    chip.append(menu, away);
    return chip;
  }

  fileOf(id) {
    return this.names.get(id)?.file ?? "";
  }

  // With its time where another one over this log has the same.
  nameOf(id) {
    const { name, began } = this.names.get(id) ?? { name: "the other log" };
    const alike = this.view.others.some((other) => other !== id && this.names.get(other)?.name === name);
    return alike && began ? `${name}, ${began}` : name;
  }

  // Say what the ghost shows at the cursor, in the first other log's own time, and return each other log's values there:
  // none before its first sample, when there is no ghost, nor after its last one, where the ghost stands still.
  at({ t, others: found }, ghost) {
    const known = this.plots.others.length === found.length ? this.plots.others : []; // else an answer of before
    const values = known.map((other, place) => {
      const { duration_s: end, done } = other.log.document;
      const [before, after] = [t - other.offset < -HALF_SAMPLE_S, t - other.offset > end + HALF_SAMPLE_S];
      const word = before ? "has not begun" : !after ? `at ${found[place].t.toFixed(3)} s` : `${done ? "ended at" : "has been read up to"} ${end.toFixed(3)} s`;
      if (place === 0) {
        this.ghost.querySelector(".name").textContent = this.nameOf(other.log.id);
        this.ghost.querySelector(".at").textContent = word;
      }
      return before || after ? {} : found[place].values;
    });
    this.ghost.hidden = !ghost || known.length === 0;
    return values;
  }

  async learnDifference(id) {
    this.set.set(id, await get(`/api/logs/${this.log.id}/difference?other=${id}`));
    this.show();
  }

  // A row for each setting that this and the other log have otherwise.
  difference(id) {
    const place = Object.assign(document.createElement("div"), { className: "items difference" });
    place.append(Object.assign(document.createElement("p"), { className: "faint", textContent: this.fileOf(id) }));
    const rows = this.set.get(id) ?? [];
    if (rows.length === 0) place.append(this.set.has(id) ? "Nothing was set differently." : "What was set differently is being read.");
    else {
      const table = document.createElement("table");
      const [head, body] = [table.createTHead().insertRow(), table.createTBody()];
      head.append(...["Set differently", "this log", "the other"].map((text) => Object.assign(document.createElement("th"), { scope: "col", textContent: text })));
      const texts = rows.map(({ key, this: own, other }) => [key.replace(/^trial\.(specification\.)?/, ""), own ?? NOT_SET, other ?? NOT_SET]);
      for (const cells of new Map(texts.map((cells) => [cells.join(), cells])).values()) { // some stand twice in a log
        const row = body.insertRow();
        for (const text of cells) row.insertCell().textContent = NAME.test(text) ? plain(text) : text;
      }
      table.tabIndex = -1;
      place.append(table);
    }
    return place;
  }
}
