// The queue: what the server says of it, and the buttons that change it. The server decides, this asks.

import { get, post } from "./api.js";
import { whyNoRun } from "./control.js";
import { showError } from "./errors.js";
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
  // onEntries is given the entries, and whether this page has control, whenever there are other ones, or something has become of one.
  constructor(live, onEntries) {
    this.onEntries = onEntries;
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
    if (queue.running && !this.queue?.running) $("add").open = false; // the table and what runs have the room
    this.queue = queue;
    const state = $("queue-state");
    state.dataset.running = String(queue.running);
    const counted = queue.entries.filter((entry) => entry.state !== "cancelled");
    const ended = counted.filter((entry) => FINAL.has(entry.state)).length;
    const done = queue.reason === "all of it is done";
    write(state, queue.running ? `runs for ${queue.operator}` : done ? "done" : "paused");
    write($("queue-reason"), queue.reason === null || done ? "" : `${queue.reason[0].toUpperCase()}${queue.reason.slice(1)}.`);
    $("queue-progress").value = counted.length ? ended / counted.length : 0;
    const left = ended < counted.length ? `, ${timeLeft(queue.time_left_s)}` : "";
    write($("queue-left"), counted.length ? `${ended} of ${counted.length}${left}` : "");
    this.showButtons();
    const shown = JSON.stringify([queue.entries, this.mine()]);
    if (shown === this.shown) return; // what has the focus keeps it
    this.shown = shown;
    this.onEntries(queue.entries, this.mine());
  }

  mine() {
    return this.view?.status?.holder === this.view?.you && Boolean(this.view);
  }

  showButtons() {
    if (this.queue === null || this.view === null) return;
    const { running, entries } = this.queue;
    const lease = this.mine() ? null : "Take control first";
    const waits = entries.some((entry) => entry.state === "waiting");
    const why = this.view.status?.phase === "moving" && this.mine() ? null : whyNoRun(this.view);
    write($("queue-start"), entries.some((entry) => FINAL.has(entry.state)) ? "Resume" : "Start");
    allow($("queue-start"), running ? "It runs" : waits ? why : "Nothing waits", "One trial after the other, until something fails");
    allow($("queue-pause"), LOOKS ?? (running ? null : "It is paused"), "Start nothing more; the trial that runs goes on to its end");
    allow($("queue-cancel"), LOOKS ?? (entries.some((entry) => entry.state === "running") ? null : "No trial of the queue runs"), "Stop the trial that runs, the same as STOP");
    allow($("clear-finished"), lease ?? (entries.some((entry) => FINAL.has(entry.state)) ? null : "Nothing is finished"), "Take what has ended off the queue: logs stay, means begin anew");
    allow($("clear-all"), lease ?? (entries.length ? null : "It is empty"), "Take all but what runs off the queue; logs stay");
    $("past-failures").disabled = running;
    if (running) $("past-failures").checked = this.queue.past_failures;
  }
}
