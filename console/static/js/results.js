// The results of a campaign: every column of its table, sorted and filtered here, with the log behind each row.

import { get, post } from "./api.js";
import { showError } from "./errors.js";
import { plain } from "./formats.js";
import { cell } from "./log_table.js";

// Shown first, and where there are none of them every column is: a table of 60 columns cannot be read.
const FIRST = [
  "experiment", "conditions", "reference", "controller", "object", "displacement_mm", "repetition", "seed", "success",
  "failure_reason", "average_force_norm", "max_lift_mm", "peak_torque_ratio",
];
const MANY = 14;

function text(value) {
  if (value === null) return "";
  return typeof value === "number" && !Number.isInteger(value) ? value.toPrecision(4) : plain(value);
}

export class Results {
  constructor(panel, chosen) {
    this.panel = panel;
    this.chosen = chosen;
    this.table = panel.querySelector("table");
    this.filter = panel.querySelector("#filter");
    this.count = panel.querySelector("#count");
    this.empty = panel.querySelector(".empty");
    this.data = { columns: [], rows: [], logs: [] };
    this.sort = { column: null, descending: false };
    this.asked = "";
    this.filter.addEventListener("input", () => this.show());
  }

  // Asks again only where there are other results than before.
  async refresh(id, done) {
    const asked = `${id} ${done}`;
    if (asked === this.asked) return;
    this.asked = asked;
    try {
      const data = await get(`/api/campaigns/${id}/results`);
      if (asked !== this.asked) return;
      this.data = data;
      this.show();
    } catch (error) {
      this.asked = "";
      showError(`The results are not up to date: ${error.message}`);
    }
  }

  show() {
    const { columns, rows, logs } = this.data;
    const first = FIRST.map((name) => columns.indexOf(name)).filter((place) => place >= 0);
    const places = first.length > 2 ? first : columns.map((_, place) => place).slice(0, MANY);
    const words = this.filter.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const known = rows.map((row, index) => ({ row, log: logs[index], words: row.map(plain).join(" ").toLowerCase() }));
    const found = known.filter((one) => words.every((word) => one.words.includes(word)));
    const place = columns.indexOf(this.sort.column);
    if (place >= 0) {
      const way = this.sort.descending ? -1 : 1;
      found.sort(({ row: a }, { row: b }) => {
        const [left, right] = [a[place], b[place]];
        if (left === null || right === null) return (left === null) - (right === null);
        return way * (left < right ? -1 : left > right ? 1 : 0);
      });
    }
    this.showHead(places.map((at) => columns[at]));
    this.table.tBodies[0].replaceChildren();
    for (const { row, log } of found) {
      const line = this.table.tBodies[0].insertRow();
      for (const at of places) cell(line, text(row[at]), typeof row[at] === "number" ? "number" : "");
      const last = line.insertCell();
      if (log === null) continue;
      last.append(this.opener(log));
      line.dataset.opens = "";
      line.addEventListener("click", ({ target }) => !target.closest("button") && !String(getSelection()) && this.open(log));
    }
    this.count.textContent = found.length === rows.length ? `${rows.length}` : `${found.length} of ${rows.length}`;
    this.empty.hidden = found.length > 0;
    this.empty.textContent = rows.length ? "No result matches the filter." : "No result yet.";
  }

  showHead(names) {
    const head = this.table.tHead.rows[0];
    head.replaceChildren();
    for (const name of [...names, null]) {
      const heading = document.createElement("th");
      if (name === null) heading.textContent = "Log";
      else {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = plain(name);
        button.addEventListener("click", () => {
          this.sort = { column: name, descending: this.sort.column === name && !this.sort.descending };
          this.show();
          head.querySelectorAll("button")[names.indexOf(name)].focus();
        });
        if (this.sort.column === name) heading.setAttribute("aria-sort", this.sort.descending ? "descending" : "ascending");
        heading.append(button);
      }
      head.append(heading);
    }
  }

  // The log is put among the logs, where it can be reviewed.
  opener(id) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "small";
    button.textContent = "open";
    button.title = "Put its log among the logs, and review it";
    button.addEventListener("click", () => this.open(id));
    return button;
  }

  async open(id) {
    try {
      const { log } = await post(`/api/campaigns/${this.chosen()}/logs/${id}`);
      location.assign(`/logs/${log}`);
    } catch (error) {
      showError(`Its log is not shown: ${error.message}`);
    }
  }
}
