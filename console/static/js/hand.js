// The operator's hand: a clutch that is held is said again and again, and whatever ends the holding is said at once. A
// page that is frozen, closed or gone says nothing any more: the robot process notices by itself.

import { Commands } from "./commands.js";
import { GamepadDevice, KeyboardDevice, PhoneDevice, SpaceMouseDevice } from "./devices.js";
import { isTextField } from "./stop.js";

const BEAT_MS = 50;
const RETRY_MS = 1000;
const THERE_MS = 400; // after the request is where it is led to: the filtered command comes after it
const LONGEST_MS = 15_000; // of a way back

export class Hand {
  constructor(live) {
    this.commands = new Commands(live);
    this.keyboard = new KeyboardDevice();
    this.gamepad = new GamepadDevice();
    this.spaceMouse = new SpaceMouseDevice();
    this.phone = new PhoneDevice();
    this.devices = [this.keyboard, this.gamepad, this.spaceMouse, this.phone]; // the first one that asks for something leads
    this.usable = false; // whether a teleoperation of ours runs
    this.held = false; // as we hold it
    this.by = null; // what holds it: key, button, mouse, undo, straighten, guide, or a device's name
    this.leading = null; // undo or straighten while the hands are led: {name, sinceMs, thereMs}
    this.dragHolds = false; // whether a mouse button that is down in the scene holds the clutch, once it drags a gizmo
    this.problem = null;
    this.dropped = null; // what held it when the console let go: it has to be let go before it holds again
    this.listeners = [];
    this.connect();
    this.listen(window);
    const scene = document.getElementById("scene");
    scene.addEventListener("load", () => {
      this.listen(scene.contentWindow);
      this.listenForDrags(scene.contentWindow);
    });
    document.addEventListener("visibilitychange", () => document.hidden && this.letGo(true));
    window.addEventListener("pagehide", () => this.letGo(true));
    setInterval(() => this.beat(), BEAT_MS);
  }

  onChange(listener) {
    this.listeners.push(listener);
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/api/teleoperation/hand`);
    this.socket.addEventListener("message", (message) => this.learn(JSON.parse(message.data)));
    this.socket.addEventListener("close", () => {
      this.drop("the console does not answer");
      setTimeout(() => this.connect(), RETRY_MS);
    });
  }

  say(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  // Keys are heard in this page and in the scene's frame.
  listen(target) {
    target.addEventListener("keydown", (event) => this.keyDown(event), { capture: true });
    target.addEventListener("keyup", (event) => this.keyUp(event));
    target.addEventListener("blur", () => setTimeout(() => !document.hasFocus() && this.letGo(true)));
  }

  // The console knows whether it is a gizmo that is dragged: until then the button that is down holds nothing.
  listenForDrags(target) {
    const up = () => this.by === "mouse" && this.letGo(false);
    target.addEventListener("pointerdown", (event) => this.dragHolds && event.button === 0 && this.press("mouse"), { capture: true });
    for (const name of ["pointerup", "pointercancel"]) target.addEventListener(name, up, { capture: true });
    target.addEventListener("pointermove", (event) => event.buttons === 0 && up(), { capture: true });
  }

  keyDown(event) {
    if (isTextField(event.target) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.code === "KeyC" && !event.repeat) this.press("key");
    else if (this.usable && this.keyboard.key(event, true)) {
      event.preventDefault();
      event.stopPropagation(); // the scene would move its camera by the same keys
    }
  }

  keyUp(event) {
    if (event.code === "KeyC" && this.by === "key") this.letGo(false);
    else this.keyboard.key(event, false);
  }

  press(by) {
    if (!this.usable || this.held) return;
    this.open(); // a key or a button that is pressed was up before
    this.held = true;
    this.by = by;
    this.problem = null;
    this.beat();
    this.tell();
  }

  // Lead the hands by one click: with the clutch that is held, or holding it until they are there.
  lead(name) {
    if (!this.usable || this.leading) return;
    this.leading = { name, sinceMs: performance.now(), thereMs: null };
    this.press(name);
    this.beat();
    this.tell();
  }

  // leading: whether the console still leads the request; still: whether the arms have come to it.
  follow(leading, still) {
    if (!this.leading) return;
    const now = performance.now();
    const { name, sinceMs } = this.leading;
    if (leading || !still) this.leading.thereMs = null;
    else this.leading.thereMs ??= now;
    if (now - sinceMs < LONGEST_MS && (this.leading.thereMs === null || now - Math.max(this.leading.thereMs, sinceMs) < THERE_MS)) return;
    this.leading = null;
    if (this.by === name) this.letGo(false);
    else this.tell();
  }

  letGo(lost) {
    this.leading = null;
    for (const device of this.devices) device.forget?.();
    if (!this.held) return;
    this.held = false;
    this.by = null;
    this.say({ clutch: false, lost });
    this.tell();
  }

  // It is not held any more, whatever the hand does.
  drop(problem) {
    if (!this.held) return;
    this.held = false;
    this.leading = null;
    [this.dropped, this.by] = [this.by, null];
    this.problem = problem;
    this.tell();
  }

  // What held it has been let go.
  open() {
    if (this.dropped) this.say({ clutch: false });
    this.dropped = null;
  }

  beat() {
    const holds = this.devices.find(({ clutch }) => clutch);
    const by = this.devices.find(({ name }) => name === this.by);
    if (by && !by.clutch) this.letGo(by.clutch === null);
    else if (!holds && this.devices.some(({ name }) => name === this.dropped)) this.open();
    else if (holds && this.usable && !this.held && !this.dropped) {
      this.held = true;
      this.by = holds.name;
      this.tell();
    }
    if (!this.held) return;
    const message = this.by === "mouse" ? { grip: true } : { clutch: true };
    if (this.leading) message.lead = this.leading.name;
    for (const device of this.leading ? [] : this.devices) {
      const deflection = device.read();
      if (!deflection) continue;
      Object.assign(message, { deflection, sensed: device.sensed });
      break;
    }
    this.say(this.commands.stamped(message));
  }

  learn({ error }) {
    if (error && this.held) this.drop(error);
  }

  tell() {
    for (const listener of this.listeners) listener();
  }
}
