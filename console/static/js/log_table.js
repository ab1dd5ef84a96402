// A table of logs: search, filter and order are the server's, so that a program can ask for the same. The headings say
// which columns there are (data-column) and which of them order the rows (data-key of the button inside).

import { get } from "./api.js";
import { showError } from "./errors.js";
import { number, plain, shift, size, when } from "./formats.js";
import { save } from "./review/saving.js";

const REFRESH_MS = 5000;
const NO_MATCH = "No log matches the filter.";

export function cell(row, text, kind = "") {
  const element = row.insertCell();
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

export function link(address, text, title = "") {
  const element = document.createElement("a");
  element.href = address;
  element.textContent = text;
  if (title) element.title = title;
  return element;
}

function outcome(row, log) {
  const element = cell(row, log.outcome, "outcome");
  element.dataset.outcome = log.success === null ? "none" : log.success ? "success" : "failure";
  element.title = log.note ? `${log.outcome}; note: ${log.note}` : log.outcome;
}

function file(row, log, heading) {
  const place = row.insertCell();
  if (heading.closest("[data-decide]") && log.decision !== null && log.success !== null) {
    const text = log.decision === "open" ? "decide" : log.decision;
    place.append(link(`/recordings/${log.id}`, text, "What is extracted from this recording, and whether trials may follow it"), " ");
  }
  const download = link(`/api/logs/${log.id}/download`, heading.dataset.text, log.name);
  download.download = log.name;
  place.append(download);
}

const COLUMNS = {
  when: (row, log) => cell(row, when(log.when)),
  name: (row, log) => {
    const place = cell(row, "", "name");
    place.append(log.kind === "not ours" ? log.name : link(`/logs/${log.id}`, log.name));
    place.title = log.name;
  },
  kind: (row, log) => cell(row, log.kind),
  controller: (row, log) => cell(row, plain(log.controller)),
  object: (row, log) => cell(row, plain(log.object)),
  title: (row, log) => cell(row, log.title || plain(log.object)),
  displacement_mm: (row, log) => cell(row, shift(log), "number"),
  seed: (row, log) => cell(row, plain(log.seed), "number"),
  outcome,
  verdict: (row, log) => cell(row, plain(log.verdict)),
  average_force_norm: (row, log) => cell(row, number(log.average_force_norm, 1), "number"),
  max_lift_mm: (row, log) => cell(row, number(log.max_lift_mm, 0), "number"),
  size_bytes: (row, log) => cell(row, size(log.size_bytes), "number"),
  file,
};

const quoted = (value) => (value === null ? "" : `"${String(value).replaceAll('"', '""')}"`);

export class LogTable {
  // query: what is asked for, besides the order; columns: of this table alone; always: asked for, and no filter of a person.
  constructor(table, query, { columns = {}, always = {} } = {}) {
    this.body = table.tBodies[0];
    this.headings = [...table.tHead.rows[0].cells];
    this.columns = { ...COLUMNS, ...columns };
    this.query = query;
    this.always = always;
    this.empty = table.parentElement.querySelector(".empty");
    this.nothing = this.empty.textContent;
    this.count = document.getElementById("count");
    this.key = "when";
    this.descending = true;
    this.rows = [];
    this.shown = "";
    this.asked = 0;
    for (const button of table.tHead.querySelectorAll("button")) {
      button.addEventListener("click", () => this.sortBy(button.dataset.key));
    }
    setInterval(() => this.refresh(), REFRESH_MS);
    this.refresh();
  }

  async refresh() {
    const number = ++this.asked;
    const asked = this.query();
    try {
      const rows = await get(`/api/logs?${new URLSearchParams({ ...this.always, ...asked, sort: this.key, descending: this.descending })}`);
      if (number !== this.asked) return; // a newer question is on its way
      this.rows = rows;
      this.show(Object.values(asked).some((value) => !["", "any"].includes(value)));
    } catch (error) {
      showError(`The list of logs is not up to date: ${error.message}`);
    }
  }

  sortBy(key) {
    this.descending = this.key === key ? !this.descending : key === "when";
    this.key = key;
    for (const heading of this.headings) {
      if (heading.querySelector("button")?.dataset.key === key) heading.setAttribute("aria-sort", this.descending ? "descending" : "ascending");
      else heading.removeAttribute("aria-sort");
    }
    this.refresh();
  }

  show(searching) {
    this.empty.hidden = this.rows.length > 0;
    this.empty.textContent = searching ? NO_MATCH : this.nothing;
    const shown = JSON.stringify(this.rows);
    if (shown === this.shown) return; // nothing new: what has the focus keeps it
    this.shown = shown;
    this.body.replaceChildren();
    for (const log of this.rows) {
      const row = this.body.insertRow();
      row.dataset.id = log.id;
      for (const heading of this.headings) this.columns[heading.dataset.column](row, log, heading);
    }
    this.count.textContent = this.rows.length === 1 ? "1 log" : `${this.rows.length} logs`;
  }

  // What is on screen, in its order, as a file.
  saveCsv(name) {
    const keys = this.headings.flatMap((heading) => heading.querySelector("button")?.dataset.key ?? []);
    const value = (log, key) => (key === "when" ? when(log.when) : log[key]);
    const lines = this.rows.map((log) => keys.map((key) => quoted(value(log, key))).join(","));
    save(new Blob([[keys.join(","), ...lines].join("\n") + "\n"], { type: "text/csv" }), name);
  }
}
