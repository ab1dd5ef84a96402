// What became of an episode, by one key straight after it: kept, failed, discard; again discards it and makes the same
// order ready, which then begins as any other one. A foot pedal is a keyboard: the keys are chosen in the row.

import { get, post } from "./api.js";
import { showError } from "./errors.js";
import { remember } from "./memory.js";
import { keep } from "./remarks.js";
import { LOOKS } from "./scope.js";
import { isTextField } from "./stop.js";

const ACTIVE = new Set(["starting", "running", "stopping"]);
const EPISODES = { teleoperation: "hand", demonstration: "demonstration", trial: "trial" }; // the tab of each
const KINDS = ["recording", "demonstration", "trial"];
export const SAID = { kept: "Kept", failed: "Kept as a failure", discard: "Discarded: data sets leave it out" };

// Keep what a person says of the episode of a job. A recording that is kept is offered to trials, another one is not.
// Returns a line; follow: called with the id of a log that trials may follow.
export async function decide(job, verdict, follow = () => {}) {
  const log = (await get(`/api/logs?q=${encodeURIComponent(job.log)}`)).find(({ name }) => name === job.log);
  if (!log) throw new Error(`${job.log} is not in the list of logs`);
  await keep(log, { verdict });
  if (log.decision === null) return `${SAID[verdict]}.`;
  const { acceptance } = await get(`/api/recordings/${log.id}?wait=false`);
  try {
    await post(`/api/recordings/${log.id}`, { ...acceptance, verdict: verdict === "kept" ? "accepted" : "rejected" });
  } catch (error) {
    if (verdict !== "kept") throw error;
    return `Kept, but no trial may follow it: ${error.message}.`;
  }
  if (verdict !== "kept") return `${SAID[verdict]}.`;
  follow(log.id);
  return `Accepted: trials may follow ${job.log}.`;
}

// "3 kept of 5 today": of this folder's recordings, demonstrations and trials.
async function countOfToday() {
  const today = new Date().toDateString();
  const logs = (await get("/api/logs")).filter(({ when, kind }) => KINDS.includes(kind) && new Date(when * 1000).toDateString() === today);
  return `${logs.filter((log) => log.episode_verdict === "kept").length} kept of ${logs.length} today`;
}

export class Outcome {
  // follow: called with the id of a log by the button that a trial follows; null on a page without it.
  constructor(live, changed, follow = null) {
    this.row = document.getElementById("episode-outcome");
    if (this.row === null) return;
    this.changed = changed;
    this.follow = document.getElementById("follow");
    this.follow?.addEventListener("click", () => follow(this.follow.value));
    this.followed = follow !== null;
    this.mine = false;
    this.asked = 0; // how many decisions
    this.seen = null; // the number of the job that this page saw run
    this.job = null; // the episode that the row is about
    this.buttons = [...this.row.querySelectorAll("[data-outcome]")];
    this.keys = [...this.row.querySelectorAll("input")];
    remember("outcome", this.keys);
    for (const input of this.keys) input.addEventListener("input", () => this.label());
    for (const button of this.buttons) button.addEventListener("click", () => this.choose(button.dataset.outcome));
    this.listen(window);
    const scene = document.getElementById("scene");
    scene?.addEventListener("load", () => this.listen(scene.contentWindow));
    live.onView((view) => this.show(view));
    this.label();
  }

  listen(target) {
    target.addEventListener("keydown", (event) => {
      if (this.row.hidden || !this.mine || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
      if (isTextField(event.target) || event.target.tagName === "SELECT" || document.querySelector("dialog[open]")) return;
      const input = this.keys.find(({ value }) => value !== "" && value.toLowerCase() === event.key.toLowerCase());
      if (input) this.buttons.find(({ dataset }) => dataset.outcome === input.dataset.of).click();
    });
  }

  label() {
    for (const input of this.keys) this.buttons.find(({ dataset }) => dataset.outcome === input.dataset.of).querySelector("kbd").textContent = input.value.toUpperCase();
  }

  show({ status, you }) {
    const job = status?.job;
    const episode = job && job.kind in EPISODES && job.log !== null && !job.title.endsWith(", training"); // that is no example
    if (episode && ACTIVE.has(job.state)) this.seen = job.number;
    const ended = episode && !ACTIVE.has(job.state) && this.seen === job.number;
    this.row.hidden = !ended || LOOKS !== null;
    if (!ended && this.job !== null) this.offer(null);
    this.mine = status?.holder === you; // keys are of the operator who has control
    if (ended && this.job?.number !== job.number) {
      this.mark(null);
      document.getElementById("outcome-line").textContent = "";
      this.offer(null);
      this.count();
    }
    this.job = ended ? job : null;
  }

  offer(id) {
    if (!this.followed || !this.follow) return;
    this.follow.hidden = id === null;
    this.follow.value = id ?? "";
  }

  async count() {
    document.getElementById("episode-count").textContent = await countOfToday().catch(() => "");
  }

  mark(verdict) {
    for (const button of this.buttons) button.setAttribute("aria-pressed", String(button.dataset.outcome === verdict));
  }

  async choose(outcome) {
    const job = this.job;
    const verdict = outcome === "again" ? "discard" : outcome;
    const [line, asked] = [document.getElementById("outcome-line"), (this.asked += 1)];
    this.mark(verdict);
    line.textContent = "Being kept ...";
    this.offer(null);
    try {
      const text = await decide(job, verdict, (id) => asked === this.asked && this.offer(id));
      if (asked !== this.asked) return; // it was decided otherwise since
      line.textContent = text;
    } catch (error) {
      this.mark(null);
      line.textContent = "";
      return showError(`Not decided: ${error.message}.`);
    }
    this.changed();
    this.count();
    if (outcome === "again") this.again(job);
  }

  // The same order as before stands in its form; it begins by its button, as it did.
  again(job) {
    const tab = EPISODES[job.kind];
    document.getElementById(`tab-${tab}`)?.click();
    const recorded = document.getElementById(job.recorded ? "record" : "practise");
    (tab === "hand" ? recorded : document.querySelector(`#${tab} button[type=submit]`))?.focus();
  }
}
