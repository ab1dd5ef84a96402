// A table of logs: search, filter and order are the server's, so that a program can ask for the same. The headings say
// which columns there are (data-column) and which of them order the rows (data-key of the button inside).

import { get } from "./api.js";
import { showError } from "./errors.js";
import { named, number, plain, shift, size, when } from "./formats.js";
import { shortWhen } from "./references.js";
import { save } from "./review/saving.js";
import { RowWindow } from "./row_window.js";

const REFRESH_MS = 5000;
const SHARE = 10; // of the time goes into asking, at most one part: a long list takes its time
const TYPING_MS = 150;
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

// Whether it can be opened: a log that begins, or a file of another program, has nothing to show.
export const known = (log) => log.kind !== "not ours";
const addressOf = (log) => (known(log) ? `/logs/${log.id}` : null);

const kind = (log) => (known(log) ? log.kind : log.outcome === "being written" ? "starting \u2026" : "unknown file");

function opener(row, log, heading) {
  const place = cell(row, "", "when");
  const [address, text] = [addressOf(log), heading.dataset.short === undefined ? when(log.when) : shortWhen(log.when)];
  place.append(address === null ? text : link(address, text, `Open ${log.name}`));
  place.title = log.name;
}

// How it ended, in a line. What an operator, a watchdog or a robot ended has not failed.
export function endOf({ ending, outcome }) {
  if (ending === "unexpected impact") return ending;
  return named(ending === "aborted" ? outcome.replace(/^failed/, ending) : outcome);
}

// How it ended: the word is coloured, the reason stands behind it.
function outcome(row, log) {
  const element = cell(row, endOf(log), "outcome");
  element.dataset.ending = log.ending;
  element.title = log.outcome;
  if (log.episode_verdict) {
    const mark = document.createElement("span");
    mark.className = "tag";
    mark.textContent = log.episode_verdict;
    mark.title = "A person's verdict";
    element.prepend(mark, " "); // before a reason, which may be cut off
  }
}

function verdict(row, log) {
  const element = cell(row, plain(log.verdict));
  if (log.verdict === "unexpected") element.dataset.ending = "unexpected impact";
}

// What people say about it: its name, its tags, its note.
function marks(row, log, heading) {
  const place = cell(row, "", "marks");
  const said = [log.starred && !heading.parentElement.querySelector("[data-column=star]") ? "\u2605" : "", log.title ? `\u201c${log.title}\u201d` : ""].filter(Boolean).join(" ");
  if (said) place.append(`${said} `);
  for (const tag of log.tags) {
    const mark = document.createElement("span");
    mark.className = "tag";
    mark.textContent = tag;
    place.append(mark, " ");
  }
  if (log.note) place.append(log.note);
  place.title = [said, log.tags.join(", "), log.note].filter(Boolean).join("; ");
}

const DECISIONS = { open: "accept or reject", said: "no reference yet", accepted: "accepted", rejected: "rejected" };

function file(row, log, heading) {
  const place = row.insertCell();
  const asked = log.decision !== null && log.success !== null && log.note !== "training"; // an exercise is no example
  if (heading.closest("[data-decide]") && asked) {
    const state = log.decision === "open" && log.episode_verdict ? "said" : log.decision; // it is looked for, or there is none
    const about = state === "open" ? "Not decided yet: look at it, and say whether trials may follow it" : "Whether trials may follow it; look at it again";
    const decision = link(`/recordings/${log.id}`, DECISIONS[state], about);
    decision.dataset.decision = state;
    place.append(decision, " ");
  }
  const download = link(`/api/logs/${log.id}/download`, heading.dataset.text, log.name);
  download.download = log.name;
  place.append(download);
}

const COLUMNS = {
  when: opener,
  kind: (row, log) => cell(row, kind(log)),
  controller: (row, log) => cell(row, plain(log.controller)),
  object: (row, log) => cell(row, plain(log.object)),
  displacement_mm: (row, log) => cell(row, shift(log), "number"),
  seed: (row, log) => cell(row, plain(log.seed), "number"),
  outcome,
  verdict,
  marks,
  average_force_norm: (row, log) => cell(row, number(log.average_force_norm, 1), "number"),
  max_lift_mm: (row, log) => cell(row, number(log.max_lift_mm, 0), "number"),
  size_bytes: (row, log) => cell(row, size(log.size_bytes), "number"),
  file,
};

const IN_ROW = "a, button, input, label, select"; // what has a meaning of its own

const beside = (row, by) => (by > 0 ? row.nextElementSibling : row.previousElementSibling);

// A row opens its log by a click, also in a new tab, and the arrow keys lead from row to row. rows: a tbody; next: returns
// the row before (-1) or after (1) one.
export function openRows(rows, next = beside) {
  rows.addEventListener("click", (event) => {
    const row = event.target.closest("tr[data-address]");
    if (!row || event.target.closest(IN_ROW) || String(getSelection())) return;
    if (event.ctrlKey || event.metaKey) open(row.dataset.address);
    else location.assign(row.dataset.address);
  });
  rows.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!by || !event.target.matches("tr a")) return;
    event.preventDefault();
    for (let row = next(event.target.closest("tr"), by); row; row = next(row, by)) {
      const link = row.querySelector("a[href^='/logs/']");
      if (link) return link.focus();
    }
  });
}

const quoted = (value) => (value === null ? "" : `"${String(value).replaceAll('"', '""')}"`);

export class LogTable {
  // query: what is asked for, besides the order; columns: of this table alone; always: asked for, and no filter of a person;
  // why: where it is said why a filter is refused; onRows: called once other rows are there.
  constructor(table, query, { columns = {}, always = {}, why = null, onRows = () => {} } = {}) {
    this.window = new RowWindow(table, (log) => this.makeRow(log));
    this.why = why;
    this.onRows = onRows;
    openRows(table.tBodies[0], (row, by) => this.window.beside(row, by));
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
    this.searching = false;
    this.shown = "";
    this.asked = 0;
    for (const button of table.tHead.querySelectorAll("button")) {
      button.addEventListener("click", () => this.sortBy(button.dataset.key));
    }
    this.typed = 0;
    this.keepUp();
  }

  async keepUp() {
    const began = performance.now();
    if (!document.hidden) await this.refresh();
    setTimeout(() => this.keepUp(), Math.max(REFRESH_MS, SHARE * (performance.now() - began)));
  }

  // Asks once a person has paused in what they type.
  async search() {
    const typed = ++this.typed;
    await new Promise((resolve) => setTimeout(resolve, TYPING_MS));
    if (typed === this.typed) await this.refresh();
  }

  async refresh() {
    const number = ++this.asked;
    const asked = this.query();
    try {
      const rows = await get(`/api/logs?${new URLSearchParams({ ...this.always, ...asked, sort: this.key, descending: this.descending })}`);
      if (number !== this.asked) return; // a newer question is on its way
      this.rows = rows;
      this.say("");
      this.show(Object.values(asked).some((value) => !["", "any"].includes(value)));
    } catch (error) {
      if (number !== this.asked) return;
      if (error.status === 422 && this.why) this.say(error.message.replace(/^q: /, ""));
      else showError(`The list of logs is not up to date: ${error.message}`);
    }
  }

  // Why the filter is refused; the rows stay as they are.
  say(text) {
    if (this.why && this.why.textContent !== text) this.why.textContent = text;
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

  // The rows in their order; a page may have others than logs.
  listed() {
    return this.rows;
  }

  show(searching = this.searching) {
    this.searching = searching;
    const rows = this.listed();
    this.empty.hidden = rows.length > 0;
    this.empty.textContent = searching ? NO_MATCH : this.nothing;
    const shown = JSON.stringify(rows);
    if (shown === this.shown) return; // nothing new: what has the focus keeps it
    this.shown = shown;
    this.window.show(rows);
    this.onRows();
    this.count.textContent = this.rows.length === 1 ? "1 log" : `${this.rows.length} logs, ${size(this.rows.reduce((sum, log) => sum + log.size_bytes, 0))}`;
  }

  makeRow(log) {
    const row = document.createElement("tr");
    if (addressOf(log)) row.dataset.address = addressOf(log);
    for (const heading of this.headings) {
      this.columns[heading.dataset.column](row, log, heading);
      row.lastElementChild.dataset.column = heading.dataset.column;
    }
    return row;
  }

  // What is on screen, in its order, as a file.
  saveCsv(name) {
    const keys = [...new Set(["name", ...this.headings.flatMap((heading) => heading.querySelector("button")?.dataset.key ?? []), "episode_verdict", "starred", "tags", "note"])];
    const value = (log, key) => (key === "when" ? new Date(log.when * 1000).toISOString() : log[key]);
    const lines = this.rows.map((log) => keys.map((key) => quoted(value(log, key))).join(","));
    save(new Blob([[keys.join(","), ...lines].join("\n") + "\n"], { type: "text/csv" }), name);
  }
}
