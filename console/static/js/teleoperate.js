// The panel of the hand: start and finish, the clutch, how the arms follow, and what the pads feel.

import { post } from "./api.js";
import { ALL_ARMS, REAL, SIDES, TWO, UNCHANGED } from "./arms.js";
import { showCamera } from "./camera.js";
import { latencyLine } from "./commands.js";
import { whyNot } from "./control.js";
import { showError } from "./errors.js";
import { showGamepad } from "./gamepad.js";
import { Hand } from "./hand.js";
import { remember } from "./memory.js";
import { isTextField } from "./stop.js";

const $ = (id) => document.getElementById(id);
const COUPLINGS = TWO ? { Digit1: "separate", Digit2: "mirrored", Digit3: "linked" } : {}; // one arm has no other
const THE_ARMS = TWO ? "the arms" : "the arm";
const READY = TWO ? "The arms are being made ready" : "The arm is being made ready";

const GUIDE = `Hold: a person may push ${ALL_ARMS}, back from beyond a limit too; ${TWO ? "they stop" : "it stops"} when it is let go`;
const HELD = { key: "C", button: "the button", gamepad: "LB", mouse: "the mouse", SpaceMouse: "its first button" };
const OPEN = "rtstack.hand settings";
const STILL_M_S = 0.002;
const LEVELS = [[0.9, "high", ", nearly at the limit"], [0.7, "near", ", near the limit"], [0, "", ""]]; // shares of the limit

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

function allow(button, why, what = "") {
  button.disabled = why !== null;
  button.title = why ?? what;
}

function clock(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

export class Teleoperate {
  constructor(live) {
    this.hand = new Hand(live);
    this.view = null;
    $("practise").addEventListener("click", () => this.start(false));
    $("record").addEventListener("click", () => this.start(true));
    $("finish").addEventListener("click", () => this.finish());
    for (const input of document.querySelectorAll("input[name=coupling]")) {
      input.addEventListener("change", () => this.hand.say({ coupling: input.value }));
    }
    for (const [id, key] of [["speed", "speed_m_s"], ["stiffness", "stiffness_n_m"]]) {
      $(id).addEventListener("input", () => {
        this.showSettings();
        this.hand.say({ [key]: $(id).valueAsNumber });
      });
    }
    $("keys-side")?.addEventListener("change", () => this.choose());
    for (const device of [this.hand.spaceMouse, this.hand.phone]) {
      $(device.name.toLowerCase()).addEventListener("click", () => this.find(device));
    }
    $("spacemouse").hidden = !navigator.hid;
    $("drag-holds").addEventListener("change", (event) => {
      this.hand.dragHolds = event.target.checked;
    });
    for (const input of document.querySelectorAll("input[name=handles]")) {
      input.addEventListener("change", () => {
        this.choose();
        this.hand.say({ handles: input.value });
      });
    }
    remember("hand", document.querySelectorAll("#hand input, #hand select, #camera-name"));
    if ($("camera")) this.hand.commands.camera = showCamera($("camera"), $("camera-name"), live);
    this.hand.dragHolds = $("drag-holds").checked;
    this.choose();
    this.holdable($("clutch"), "button");
    for (const name of ["undo", "straighten"]) $(name).addEventListener("click", () => this.hand.lead(name));
    $("settings").open = localStorage.getItem(OPEN) === "true";
    $("settings").addEventListener("toggle", () => localStorage.setItem(OPEN, $("settings").open));
    this.guiding = false; // whether its button is down
    this.holdable($("guide"), "guide", () => this.guide());
    for (const target of [window, $("scene")]) {
      const listen = (window_) => window_.addEventListener("keydown", (event) => this.key(event));
      if (target === window) listen(window);
      else target.addEventListener("load", () => listen(target.contentWindow));
    }
    this.hand.onChange(() => this.view && this.show(this.view));
    live.onView((view) => this.show(view));
    this.showSettings();
  }

  // Which hand a device for one hand leads, and whether a phone turns it.
  choose() {
    for (const device of this.hand.devices) device.side = $("keys-side")?.value ?? SIDES[0];
    this.hand.phone.turns = document.querySelector("input[name=handles]:checked").value === "turn";
  }

  // A browser lets a page have a device only after a click.
  async find(device) {
    try {
      await device.find();
    } catch (error) {
      showError(`No ${device.name}: ${error.message}.`);
    }
  }

  // A button that holds the clutch while it is pressed, by a pointer or by Enter.
  holdable(button, by, press = () => this.hand.press(by)) {
    button.addEventListener("pointerdown", (event) => {
      button.setPointerCapture(event.pointerId);
      press();
    });
    const up = () => {
      if (by === "guide") this.guiding = false;
      if (this.hand.by === by) this.hand.letGo(false);
    };
    for (const name of ["pointerup", "pointercancel", "lostpointercapture", "keyup", "blur"]) button.addEventListener(name, up);
    button.addEventListener("keydown", (event) => event.key === "Enter" && !event.repeat && press());
  }

  // The job begins with its button, and the clutch is held as soon as the job can take it.
  async guide() {
    this.guiding = true;
    try {
      await post("/api/jobs/guide");
    } catch (error) {
      this.guiding = false;
      showError(`Not begun: ${error.message}. ${UNCHANGED}`);
    }
  }

  key(event) {
    if (event.repeat || isTextField(event.target) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.code in COUPLINGS) {
      document.querySelector(`input[name=coupling][value=${COUPLINGS[event.code]}]`).click();
    } else if (event.code === "KeyG") {
      document.querySelector("input[name=handles]:not(:checked)").click();
    } else if (event.code === "KeyR") {
      const button = $("finish").hidden ? $("record") : $("finish");
      if (!button.disabled && !$("hand").hidden) button.click();
    }
  }

  async start(recorded) {
    for (const id of ["practise", "record"]) $(id).disabled = true;
    const release = document.querySelector("input[name=release]:checked").value;
    const order = { object: $("hand-object").value, recorded, stop_on_release: release === "stop" };
    try {
      await post("/api/jobs/teleoperation", order);
      this.hand.say({
        ...(TWO && { coupling: document.querySelector("input[name=coupling]:checked").value }),
        speed_m_s: $("speed").valueAsNumber,
        stiffness_n_m: $("stiffness").valueAsNumber,
        handles: document.querySelector("input[name=handles]:checked").value,
      });
    } catch (error) {
      showError(`Not started: ${error.message}. ${UNCHANGED}`);
    }
  }

  async finish() {
    try {
      await post("/api/teleoperation/finish");
    } catch (error) {
      showError(`Not finished: ${error.message}. STOP ends it too.`);
    }
  }

  showSettings() {
    write($("speed-value"), `${$("speed").valueAsNumber.toFixed(2)} m/s`);
    write($("stiffness-value"), `${$("stiffness").valueAsNumber} N/m`);
  }

  show(view) {
    this.view = view;
    const { status, you } = view;
    const job = status?.job;
    const active = job?.kind === "teleoperation" && ["starting", "running", "stopping"].includes(job.state);
    const mine = status?.holder === you;
    const led = SIDES.every((side) => view[side].mode === "TELEOPERATION");
    const guided = job?.kind === "guide" && job.state === "running";
    const watched = REAL && !active && job?.state === "running";
    this.hand.usable = ((active && job.state === "running" && led) || guided || watched) && mine && !view.unreachable;
    if (!this.hand.usable && this.hand.held) this.hand.letGo(false);
    if (guided && this.guiding) this.hand.press("guide");
    const wayOut = status?.phase === "fault" && mine && !["starting", "running", "stopping"].includes(job?.state);
    allow($("guide"), guided || this.guiding || wayOut ? null : whyNot(view), GUIDE);
    $("guide").dataset.state = guided ? "held" : "";
    if (!active) this.hand.problem = null;
    const why = whyNot(view);
    $("practise").hidden = $("record").hidden = active;
    $("finish").hidden = !active;
    allow($("practise"), why, `Move ${THE_ARMS} by hand; it is logged, and no ${TWO ? "reference" : "recording"}`);
    allow($("record"), why, TWO ? "Record a reference by hand, from the arms' home (R)" : "Record by hand, from the arm's home (R)");
    allow($("finish"), !mine ? "Only the operator with control" : job?.state === "running" ? null : "Wait a moment", `Stop ${THE_ARMS} and finish the log (R)`);
    for (const input of document.querySelectorAll("input[name=release], #hand-object")) input.disabled = active;
    for (const input of document.querySelectorAll("input[name=coupling], input[name=handles], #speed, #stiffness")) input.disabled = active && !mine;
    if (active) this.hand.follow(view.hand.leading, SIDES.every((side) => (view[side].speed_m_s ?? 0) < STILL_M_S));
    this.showClutch(view, active, mine, why);
    for (const side of SIDES) this.showForce(side, view[side].peak_force_n);
    this.showRecording(active, job);
    this.showDevices();
  }

  showClutch(view, active, mine, why) {
    const clutch = $("clutch");
    const held = (this.hand.held && this.hand.by !== "mouse") || (active && view.hand.held);
    clutch.dataset.state = held ? "held" : this.hand.usable ? "ready" : "off";
    write(clutch, held ? "Clutch held" : "Hold to move");
    const line = $("hand-line");
    const refused = active ? view.hand.refusal : null;
    const usable = this.hand.usable ? null : why ?? (active ? READY : "Start or record first");
    allow(clutch, usable);
    const lead = usable ?? (this.hand.leading ? "The hands are on their way" : REAL && !this.hand.held ? "Hold the clutch, then press this" : null);
    allow($("undo"), lead ?? (view.hand.drags ? null : "No drag to undo"), "The hands go back to where they were before the last drag");
    allow($("straighten"), lead, "The hands turn until they are square to the table");
    const text = refused ?? this.hand.problem ?? this.hint(active, held, mine, why);
    write(line, text);
    line.dataset.tone = refused || this.hand.problem ? "bad" : "";
    $("scene").parentElement.dataset.clutch = held ? "held" : "";
  }

  hint(active, held, mine, why) {
    if (!active) return why ?? "";
    if (!mine) return `Another operator moves ${THE_ARMS}.`;
    const holds = document.querySelector("input[name=release]:checked").value === "hold";
    if (this.hand.leading) return `${this.hand.leading.name === "undo" ? "The last drag is undone" : "The hands are straightened"}. STOP stops.`;
    if (held) {
      const then = holds ? (TWO ? "the arms hold position" : "the arm holds position") : `the ${this.view.status.job.recorded ? "recording" : "practice"} ends`;
      return `${TWO ? "The arms follow" : "The arm follows"}. Release ${HELD[this.hand.by] ?? "the clutch"}: ${then}.`;
    }
    if (!this.hand.usable) return `${READY}.`;
    const what = $("drag-holds").checked ? "Drag" : "Hold C and drag";
    return `${what} ${document.querySelector("input[name=handles]:checked").value === "turn" ? "a ring" : "an arrow"} in the scene, or hold C and jog with W A S D Q E.`;
  }

  // newtons: of the side's pad, null where they are not known.
  showForce(side, newtons) {
    const place = $(`force-${side}`);
    const limit = Number(place.dataset.limit);
    const share = Math.min((newtons ?? 0) / limit, 1);
    const [, level, words] = LEVELS.find(([least]) => share >= least);
    place.dataset.level = level;
    const meter = place.querySelector("[role=meter]");
    meter.style.setProperty("--share", share);
    meter.ariaValueNow = Math.round(newtons ?? 0);
    write(place.querySelector("output"), `${newtons === null ? "-" : newtons.toFixed(0)} of ${limit} N${words}`);
  }

  showRecording(active, job) {
    const light = $("recording");
    light.hidden = !active || !job.recorded || job.state === "starting";
    if (!light.hidden) write(light, `REC ${clock(Date.now() / 1000 - job.started_s)}`);
  }

  showDevices() {
    const { gamepad, spaceMouse, phone } = this.hand;
    const line = latencyLine(this.view.hand);
    const found = [gamepad.pad?.id.slice(0, 24), spaceMouse.device?.productName, phone.now && "phone"].filter(Boolean);
    write($("devices-line"), `${["Gizmos, keys", ...found].join(", ")}${gamepad.pad ? "" : "; no gamepad"}${line && `. ${line}`}`);
    showGamepad($("gamepad"), gamepad.mapping);
  }
}
