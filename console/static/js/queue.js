// The queue: what the server says of it, and the buttons that change it. The server decides, this asks.

import { get, post } from "./api.js";
import { whyNot } from "./control.js";
import { showError } from "./errors.js";
import { number, plain, shift } from "./formats.js";
import { cell, link, openRows } from "./log_table.js";
import { LOOKS } from "./scope.js";

const PERIOD_MS = 1000;
const $ = (id) => document.getElementById(id);
const FINAL = new Set(["succeeded", "failed", "stopped", "cancelled"]);

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

export function timeLeft(seconds) {
  if (seconds === null) return "time left not known yet";
  const whole = Math.ceil(seconds);
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  if (hours) return `${hours} h ${minutes} min left`;
  return minutes ? `${minutes} min ${whole % 60} s left` : `${whole} s left`;
}

function allow(button, why, what) {
  button.disabled = why !== null;
  button.title = why ?? what;
}

export class Queue {
  // onEntries is given the entries whenever there are other ones, or something has become of one.
  constructor(live, onEntries) {
    this.body = $("queue").tBodies[0];
    this.onEntries = onEntries;
    openRows(this.body);
    this.queue = null;
    this.view = null;
    this.shown = "";
    const act = (id, path, body = () => ({})) => $(id).addEventListener("click", () => this.change(path, body()));
    act("queue-start", "start", () => ({ past_failures: $("past-failures").checked }));
    act("queue-pause", "pause");
    act("queue-cancel", "cancel");
    act("clear-finished", "clear", () => ({ finished_only: true }));
    act("clear-all", "clear", () => ({ finished_only: false }));
    live.onView((view) => {
      this.view = view;
      this.showButtons();
    });
    setInterval(() => this.refresh(), PERIOD_MS);
    this.refresh();
  }

  async refresh() {
    try {
      this.show(await get("/api/queue"));
    } catch (error) {
      showError(`The queue is not up to date: ${error.message}`);
    }
  }

  async change(path, body = {}) {
    try {
      this.show(await post(path ? `/api/queue/${path}` : "/api/queue", body));
    } catch (error) {
      showError(`The queue stays as it is: ${error.message}`);
    }
  }

  // Adds a sweep; returns why not, in a line, or null.
  async add(sweep) {
    try {
      this.show(await post("/api/queue/sweep", sweep));
      return null;
    } catch (error) {
      return error.message;
    }
  }

  show(queue) {
    this.queue = queue;
    const state = $("queue-state");
    state.dataset.running = String(queue.running);
    write(state, queue.running ? `runs for ${queue.operator}` : "paused");
    write($("queue-reason"), queue.reason === null ? "" : `${queue.reason}.`);
    const ended = queue.entries.filter((entry) => FINAL.has(entry.state)).length;
    $("queue-progress").value = queue.entries.length ? ended / queue.entries.length : 0;
    const left = ended < queue.entries.length ? `, ${timeLeft(queue.time_left_s)}` : "";
    write($("queue-left"), queue.entries.length ? `${ended} of ${queue.entries.length}${left}` : "");
    $("queue-empty").hidden = queue.entries.length > 0;
    this.showButtons();
    const shown = JSON.stringify([queue.entries, this.mine()]);
    if (shown === this.shown) return; // what has the focus keeps it
    this.shown = shown;
    this.onEntries(queue.entries);
    const focused = document.activeElement;
    const [id, what] = [focused?.closest("#queue tr")?.dataset.id, focused?.getAttribute("aria-label")];
    this.body.replaceChildren();
    const waiting = queue.entries.filter((entry) => entry.state === "waiting");
    for (const entry of queue.entries) this.addRow(entry, waiting.indexOf(entry), waiting.length);
    if (id) this.focus(id, what);
  }

  // Who moves an entry by keys goes on with it, at its new place.
  focus(id, what) {
    const buttons = [...this.body.querySelectorAll(`tr[data-id="${id}"] button:enabled`)];
    (buttons.find((button) => button.getAttribute("aria-label") === what) ?? buttons[0])?.focus();
  }

  mine() {
    return this.view?.status?.holder === this.view?.you && Boolean(this.view);
  }

  showButtons() {
    if (this.queue === null || this.view === null) return;
    const { running, entries } = this.queue;
    const lease = this.mine() ? null : "Take control first";
    const waits = entries.some((entry) => entry.state === "waiting");
    const why = this.view.status?.phase === "moving" && this.mine() ? null : whyNot(this.view);
    write($("queue-start"), entries.some((entry) => FINAL.has(entry.state)) ? "Resume" : "Start");
    allow($("queue-start"), running ? "It runs" : waits ? why : "Nothing waits", "One trial after the other, until something fails");
    allow($("queue-pause"), LOOKS ?? (running ? null : "It is paused"), "Start nothing more; the trial that runs goes on to its end");
    allow($("queue-cancel"), LOOKS ?? (entries.some((entry) => entry.state === "running") ? null : "No trial of the queue runs"), "Stop the trial that runs, the same as STOP");
    allow($("clear-finished"), lease ?? (entries.some((entry) => FINAL.has(entry.state)) ? null : "Nothing is finished"), "Their logs stay");
    allow($("clear-all"), lease ?? (entries.length ? null : "It is empty"), "Everything but what runs; logs stay");
    $("past-failures").disabled = running;
    if (running) $("past-failures").checked = this.queue.past_failures;
  }

  addRow(entry, place, waiting) {
    const row = this.body.insertRow();
    row.dataset.id = entry.id;
    const word = entry.ending === "unexpected impact" ? `${entry.state}, ${entry.ending}` : entry.state;
    const state = cell(row, entry.reason ? `${word}: ${entry.reason}` : word, "state");
    state.dataset.state = entry.state;
    if (entry.ending !== null) state.dataset.ending = entry.ending;
    if (entry.log !== null) row.dataset.address = `/logs/${entry.log}`;
    state.title = state.textContent;
    const { trial } = entry;
    const many = entry.repetitions > 1 ? `, ${entry.repetition} of ${entry.repetitions}` : "";
    const followed = cell(row, `${entry.followed}${many}`);
    followed.title = followed.textContent;
    const besides = [trial.reaction === "continue" ? null : trial.reaction, trial.law_inertia && `law with ${trial.law_inertia}`];
    cell(row, [plain(trial.controller), ...besides].filter(Boolean).join(", "));
    cell(row, plain(trial.object));
    cell(row, shift(trial), "number");
    cell(row, plain(trial.seed), "number");
    const took = entry.duration_s === null ? "" : `${number(entry.duration_s, 1)} s`;
    const log = row.insertCell();
    log.append(entry.log === null ? took : link(`/logs/${entry.log}`, took ? `open, ${took}` : "open", "Open its log; how long it took"));
    const order = cell(row, "", "order");
    const lease = this.mine() ? null : "Take control first";
    const button = (text, what, why, act) => {
      const element = document.createElement("button");
      element.type = "button";
      element.textContent = text;
      element.setAttribute("aria-label", what);
      allow(element, lease ?? why, what);
      element.addEventListener("click", act);
      order.append(element, " ");
    };
    if (place >= 0) {
      button("\u2191", "Earlier", place > 0 ? null : "It is the next", () => this.change(`${entry.id}/move`, { to: place - 1 }));
      button("\u2193", "Later", place < waiting - 1 ? null : "It is the last", () => this.change(`${entry.id}/move`, { to: place + 1 }));
      button("cancel", "Cancel this trial", null, () => this.change(`${entry.id}/cancel`));
    }
    if (entry.state !== "running") button("remove", "Take it off the list; its log stays", null, () => this.change(`${entry.id}/remove`));
  }
}
