// The page Trials' one table: what runs and waits in its order, then what has ended, as the logs say it.

import { named, plain } from "./formats.js";
import { LogTable, cell, endOf, link } from "./log_table.js";
import { shortWhen } from "./references.js";

const ENDED = { success: "succeeded", "unexpected impact": "succeeded", failure: "failed" };

// What a person filters an entry of the queue by, as for a log: words, and key:value.
const wordsOf = ({ trial, state }) => [state, ...Object.entries(trial).map(([key, value]) => `${key}:${value} ${plain(value)}`)].join(" ").toLowerCase();

function stateOf(row, item) {
  const { entry, ending, outcome } = item;
  const ended = ending !== undefined;
  const words = ended ? endOf(item) : entry.reason ? `${entry.ending === "aborted" ? entry.ending : entry.state}: ${named(entry.reason)}` : entry.state;
  const place = cell(row, words, "state");
  place.dataset.state = ended ? ENDED[ending] ?? "" : entry.state;
  if (ended) place.dataset.ending = ending;
  place.title = outcome ?? words;
}

function controllerOf(row, { controller, entry }) {
  const { reaction = "continue", law_inertia: law = null } = entry?.trial ?? {};
  const text = [plain(controller), reaction === "continue" ? null : reaction, law && `law with ${law}`].filter(Boolean).join(", ");
  cell(row, text).title = text;
}

export class TrialTable extends LogTable {
  // act(path, body): changes the queue; note(log): asks for tags and a note.
  constructor(table, query, why, act, note) {
    const columns = {
      state: stateOf,
      controller: controllerOf,
      reference: (row, { entry }) => (cell(row, entry?.followed ?? "").title = entry?.followed ?? ""),
      when: (row, { id, name, when }) => {
        const place = cell(row, "", "when");
        if (when !== null) place.append(link(`/logs/${id}`, shortWhen(when), `Open ${name}`));
      },
      order: (row, item) => this.actions(row, item),
    };
    super(table, query, { always: { kind: "trial" }, why, columns });
    Object.assign(this, { table, act, note, entries: [], mine: false });
  }

  // mine: whether this page has control
  follow(entries, mine) {
    Object.assign(this, { entries, mine });
    this.table.classList.toggle("references", new Set(entries.map(({ followed }) => followed)).size > 1);
    this.show();
  }

  listed() {
    const { q, outcome } = this.query();
    const words = q.toLowerCase().split(/\s+/).filter(Boolean);
    const known = new Set(this.rows.map(({ id }) => id));
    const ofLog = new Map(this.entries.filter(({ log }) => log !== null).map((entry) => [entry.log, entry]));
    const waiting = this.entries.filter(({ state }) => state === "waiting");
    const asked = (entry) => outcome === "any" && words.every((word) => wordsOf(entry).includes(word));
    const open = this.entries.filter((entry) => (entry.log === null ? asked(entry) : !this.searching && !known.has(entry.log)));
    const planned = open.map((entry) => ({
      id: entry.id, ...entry.trial, when: null, average_force_norm: null, entry, place: waiting.indexOf(entry), waiting: waiting.length, mine: this.mine,
    }));
    const runs = open.some(({ state }) => state === "running"); // its row stands for the log that is being written
    const rows = this.rows.filter(({ outcome: end }) => !(runs && end === "being written"));
    return [...planned, ...rows.map((log) => (ofLog.has(log.id) ? { ...log, entry: ofLog.get(log.id), mine: this.mine } : log))];
  }

  actions(row, { id, name, entry, place, waiting, mine, kind }) {
    const bar = document.createElement("div");
    cell(row, "", "order").append(bar);
    const button = (text, what, why, does) => {
      const made = document.createElement("button");
      Object.assign(made, { type: "button", textContent: text, title: why ?? what, disabled: why !== null });
      made.setAttribute("aria-label", what);
      made.addEventListener("click", does);
      bar.append(made);
    };
    const lease = mine ? null : "Take control first";
    if (place >= 0) {
      button("\u2191", "Earlier", lease ?? (place > 0 ? null : "It is the next"), () => this.act(`${id}/move`, { to: place - 1 }));
      button("\u2193", "Later", lease ?? (place < waiting - 1 ? null : "It is the last"), () => this.act(`${id}/move`, { to: place + 1 }));
      button("cancel", "Cancel this trial", lease, () => this.act(`${id}/cancel`));
    }
    if (kind) {
      const before = this.rows[this.rows.findIndex((log) => log.id === id) + 1];
      bar.append(Object.assign(link(`/logs/${id}`, "open", `Open ${name}`), { className: "button" }));
      if (before) bar.append(Object.assign(link(`/logs/${id}?other=${before.id}`, "compare", `Compare with the one below: ${before.name}`), { className: "button" }));
      button("note", `Tags and note of ${name}`, null, () => this.note(this.rows.find((log) => log.id === id)));
    }
    if (entry && entry.state !== "running") button("remove", "Take it off the list; its log stays", lease, () => this.act(`${entry.id}/remove`));
  }
}
