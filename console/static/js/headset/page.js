// The page for a headset's browser: what the hands say goes to the console, and what a person has to know comes back.

import { post } from "../api.js";
import { SIDES, TWO, UNCHANGED } from "../arms.js";
import { Camera } from "../camera.js";
import { Commands, latencyLine } from "../commands.js";
import { Control, whyNot } from "../control.js";
import { showError } from "../errors.js";
import { startFrame } from "../frame.js";
import { sentence } from "../job_line.js";
import { remember } from "../memory.js";
import { decide } from "../outcome.js";
import { stop } from "../stop.js";
import { tellWorth } from "../worth.js";
import { Immersion } from "./immersion.js";

const $ = (id) => document.getElementById(id);
const RETRY_MS = 1000;
const PULSE_MS = 60;
const DROPPED_MS = 400;
const FULL_N = 60; // a pulse as strong as it can be
const LEAST_N = 5; // the impact detector's force_high
const QUARTER = Math.PI / 2;
const OUTCOMES = ["kept", "failed", "discard"]; // of an episode, one after the other

class Headset {
  constructor(live) {
    this.commands = new Commands(live);
    this.immersion = new Immersion(this);
    this.camera = this.commands.camera = new Camera(() => {});
    const camera = $("camera-name");
    camera?.addEventListener("change", () => this.camera.look(camera.value));
    this.held = false;
    this.dropped = false; // the console has let go, and waits until the grips were opened
    this.running = false;
    this.view = null;
    this.felt = Object.fromEntries(SIDES.map((side) => [side, 0]));
    this.said = "-"; // the last line about the job, or about what was pressed
    for (const [id, recorded] of [["practise", false], ["record", true]]) $(id).addEventListener("click", () => this.start(recorded));
    $("finish").addEventListener("click", () => this.finish());
    this.outcome = null; // what was decided of the newest recording
    for (const outcome of OUTCOMES) $(outcome).addEventListener("click", () => this.decide(outcome));
    $("mirror")?.addEventListener("change", () => this.mirror($("mirror").checked));
    $("enter").addEventListener("click", () => this.immersion.enter());
    $("facing").addEventListener("change", () => this.face());
    remember("headset", document.querySelectorAll("#headset select"));
    if (camera) this.camera.look(camera.value);
    this.face();
    document.addEventListener("visibilitychange", () => document.hidden && this.letGo(true));
    window.addEventListener("pagehide", () => this.letGo(true));
    live.onView((view) => this.show(view));
    if (TWO) {
      tellWorth(live, (text) => {
        this.said = $("worth").textContent = text;
      });
    }
    this.connect();
    this.immersion.find();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/api/teleoperation/hand`);
    this.socket.addEventListener("message", ({ data }) => {
      const { error } = JSON.parse(data);
      if (error && this.held) this.drop(error);
    });
    this.socket.addEventListener("close", () => {
      this.drop("the console does not answer");
      setTimeout(() => this.connect(), RETRY_MS);
    });
  }

  say(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  face() {
    this.letGo(false);
    this.immersion.frames.turn = QUARTER * Number($("facing").value);
    this.immersion.frames.origin = null;
  }

  async start(recorded) {
    try {
      await post("/api/jobs/teleoperation", { object: $("headset-object").value, recorded, stop_on_release: false });
      // a hand has its own speed
      this.say({ coupling: $("mirror")?.checked ? "mirrored" : "separate", speed_m_s: Number($("headset").dataset.fastest) });
    } catch (error) {
      this.tell(`Not started: ${error.message}. ${UNCHANGED}`);
    }
  }

  async finish() {
    try {
      await post("/api/teleoperation/finish");
    } catch (error) {
      this.tell(`Not finished: ${error.message}. STOP ends it too.`);
    }
  }

  // The newest recording that has ended, null while there is none.
  get recording() {
    const job = this.view?.status?.job;
    return job?.recorded && job.log !== null && ["done", "failed", "stopped"].includes(job.state) ? job : null;
  }

  // Say what became of the newest recording: a reference is made of one that is kept.
  async decide(outcome) {
    try {
      if (!this.recording) throw new Error("there is no recording that has just been made");
      this.outcome = outcome;
      this.tell(await decide(this.recording, outcome), false);
    } catch (error) {
      this.tell(`Not decided: ${error.message}.`);
    }
  }

  // One hand leads the other pad too, as in a mirror.
  mirror(yes) {
    $("mirror").checked = yes;
    if (this.running) this.say({ coupling: yes ? "mirrored" : "separate" });
  }

  tell(text, bad = true) {
    this.said = text;
    if (bad) showError(text);
    else $("job-line").textContent = text;
  }

  // What a picture of the headset shows of the hands; pressed: newly, of each controller.
  hear({ hands, sensed, gripped, lost, pressed }) {
    const either = (name) => pressed.left.has(name) || pressed.right.has(name);
    if (either("stick") || pressed.right.has("upper")) stop();
    if (pressed.right.has("lower") || (!TWO && pressed.left.has("lower"))) this.running ? this.finish() : this.start(true);
    if (pressed.left.has("upper")) this.decide(OUTCOMES[(OUTCOMES.indexOf(this.outcome) + 1) % OUTCOMES.length]);
    if (TWO && pressed.left.has("lower")) this.mirror(!$("mirror").checked);
    if (this.dropped && !gripped) {
      this.dropped = false;
      this.say({ clutch: false });
    }
    if (lost) this.letGo(true);
    else this.lead(hands, sensed);
  }

  lead(hands, sensed) {
    if (Object.values(hands).every((hand) => hand === null) || !this.running) {
      this.letGo(false, false);
      return;
    }
    this.held = true;
    this.say(this.commands.stamped({ clutch: true, hands, sensed }));
  }

  // forget: a grip that is still held leads again only after it was let go.
  letGo(lost, forget = true) {
    if (forget) this.immersion.controllers.forgetAll();
    if (!this.held) return;
    this.held = false;
    this.say({ clutch: false, lost });
  }

  drop(problem) {
    if (!this.held) return;
    this.letGo(true);
    this.dropped = true;
    for (const side of SIDES) this.immersion.pulse(side, 1, DROPPED_MS);
    this.tell(`${TWO ? "The arms do" : "The arm does"} not follow: ${problem}.`);
  }

  get state() {
    if (this.view?.status?.phase === "fault") return "fault";
    return this.held ? "held" : this.running ? "ready" : "idle";
  }

  // What the board says.
  get lines() {
    const { hand, status } = this.view ?? {};
    const doing = { fault: `Fault: ${status?.reason}. Recover on the page`, held: `Leading: let go of the grip, and the ${TWO ? "pads stay" : "pad stays"}`, ready: `Hold ${TWO ? "a" : "the"} grip to lead. ${TWO ? "A" : "A or X"}: finish. B: STOP`, idle: TWO ? "A: record. Y: keep the recording, again: failed, discard. X: mirror" : "A or X: record. Y: keep the recording, again: failed, discard" }[this.state];
    return [doing, this.said, hand?.refusal ?? "", hand ? latencyLine(hand) : "", this.camera.line].filter((line, k) => k < 4 || line);
  }

  show(view) {
    this.view = view;
    const job = view.status?.job;
    const led = SIDES.every((side) => view[side].mode === "TELEOPERATION");
    this.running = led && job?.kind === "teleoperation" && job.state === "running" && view.status.holder === view.you;
    const why = whyNot(view);
    for (const id of ["practise", "record"]) {
      $(id).disabled = why !== null;
      $(id).title = why ?? "";
    }
    const line = job ? sentence(job, view.state.word)[0] : "-";
    if (line !== this.line) [this.line, this.said, $("job-line").textContent] = [line, line, line];
    $("finish").disabled = !this.running;
    if (this.running) this.outcome = null;
    for (const outcome of OUTCOMES) $(outcome).disabled = !this.recording;
    $("headset-state").textContent = { fault: "fault", held: "leading", ready: "hold a grip to lead", idle: "nothing is led" }[this.state];
    $("latency").textContent = view.hand.refusal ?? latencyLine(view.hand);
    for (const side of SIDES) this.feel(side, view[side].peak_force_n ?? 0);
  }

  // A pulse when a pad touches, stronger with force.
  feel(side, newtons) {
    if (newtons > LEAST_N && newtons > 1.2 * this.felt[side]) this.immersion.pulse(side, Math.min(1, newtons / FULL_N), PULSE_MS);
    this.felt[side] = newtons;
  }
}

const live = startFrame();
new Control(live);
new Headset(live);
