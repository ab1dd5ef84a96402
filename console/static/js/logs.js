// The table of logs: sorted by any column, filtered, each row with its download.

import { get } from "./api.js";
import { showError } from "./errors.js";
import { number, plain, size, when } from "./formats.js";

const body = document.querySelector("#logs tbody");
const headings = [...document.querySelectorAll("#logs th[data-key]")];
const filter = document.getElementById("filter");

// Of today: the time is enough to tell recordings apart.
function shortWhen(seconds) {
  const [day, time] = when(seconds).split(" ");
  return day === when(Date.now() / 1000).split(" ")[0] ? time : `${day} ${time.slice(0, 5)}`;
}

function cell(row, text, kind = "") {
  const element = row.insertCell();
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

function addRow(log) {
  const row = body.insertRow();
  row.dataset.id = log.id;
  cell(row, when(log.when));
  cell(row, log.kind);
  cell(row, plain(log.controller));
  cell(row, log.title || plain(log.object));
  cell(row, log.displacement_mm === null ? "" : log.displacement_mm.toFixed(0), "number");
  cell(row, plain(log.seed), "number");
  const outcome = cell(row, log.outcome, "outcome");
  outcome.dataset.outcome = log.success === null ? "none" : log.success ? "success" : "failure";
  outcome.title = log.outcome;
  cell(row, number(log.average_force_norm, 1), "number");
  cell(row, number(log.max_lift_mm, 0), "number");
  cell(row, size(log.size_bytes), "number");
  const link = document.createElement("a");
  link.href = `/api/logs/${encodeURIComponent(log.id)}/download`;
  link.download = log.name;
  link.textContent = "download";
  link.title = log.name;
  const last = row.insertCell();
  if (log.decision !== null && log.success !== null) {
    const look = document.createElement("a");
    look.href = `/recordings/${encodeURIComponent(log.id)}`;
    look.textContent = log.decision === "open" ? "decide" : log.decision;
    look.title = "What is extracted from this recording, and whether trials may follow it";
    last.append(look, " ");
  }
  last.append(link);
}

export class Logs {
  constructor(onRecordings) {
    this.onRecordings = onRecordings;
    this.logs = [];
    this.key = "when";
    this.descending = true;
    for (const heading of headings) heading.addEventListener("click", () => this.sortBy(heading.dataset.key));
    filter.addEventListener("input", () => this.show());
  }

  async refresh() {
    try {
      this.logs = await get("/api/logs");
    } catch (error) {
      showError(`The list of logs is not up to date: ${error.message}`);
      return;
    }
    this.show();
    this.offerRecordings();
  }

  sortBy(key) {
    this.descending = this.key === key ? !this.descending : false;
    this.key = key;
    for (const heading of headings) {
      if (heading.dataset.key === key) heading.setAttribute("aria-sort", this.descending ? "descending" : "ascending");
      else heading.removeAttribute("aria-sort");
    }
    this.show();
  }

  show() {
    const wanted = filter.value.trim().toLowerCase();
    const shown = this.logs.filter((log) =>
      [log.name, log.kind, log.controller, log.object, log.outcome].some((text) => plain(text).toLowerCase().includes(wanted)));
    const direction = this.descending ? -1 : 1;
    shown.sort((a, b) => {
      const [left, right] = [a[this.key], b[this.key]];
      if (left === null || right === null) return (left === null) - (right === null);
      return direction * (left < right ? -1 : left > right ? 1 : 0);
    });
    body.replaceChildren();
    for (const log of shown) addRow(log);
    const empty = document.getElementById("empty");
    empty.hidden = shown.length > 0;
    if (this.logs.length > 0) empty.textContent = "No log matches the filter.";
    document.getElementById("count").textContent =
      this.logs.length === 0 ? "" : shown.length === this.logs.length ? `${shown.length}` : `${shown.length} of ${this.logs.length}`;
  }

  offerRecordings() {
    const recordings = this.logs.filter((log) => log.recording).sort((a, b) => b.when - a.when);
    const select = document.querySelector("#trial select[name=reference]");
    const chosen = select.value;
    select.replaceChildren(...recordings.map((log) => new Option(`${log.title || plain(log.object)}, ${shortWhen(log.when)}`, log.id)));
    if (recordings.length === 0) select.add(new Option("no recording yet", ""));
    else if (recordings.some((log) => log.id === chosen)) select.value = chosen;
    this.onRecordings(recordings.length);
  }
}
