// Devices beside the gizmos. Each has a name and `read()`: {left: [6], right: [6]}, from -1 to 1 along the world's axes
// and about them, or null while it asks for nothing. One with a clutch of its own says whether it is held, null once the
// device has gone. `side`: the hand that a device with one cap, one set of keys leads.

import { SIDES } from "./arms.js";

const STEPS = {
  KeyW: [0, 1], KeyS: [0, -1], KeyA: [1, 1], KeyD: [1, -1], KeyE: [2, 1], KeyQ: [2, -1], // along x, y, z
  KeyL: [3, 1], KeyJ: [3, -1], KeyI: [4, 1], KeyK: [4, -1], KeyU: [5, 1], KeyO: [5, -1], // about x, y, z
};
const DEAD_ZONE = 0.12;
const CLUTCH_BUTTON = 4; // the left shoulder
const TURN_BUTTON = 5; // the right one
const DOWN_BUTTON = 6;
const UP_BUTTON = 7;
const MULTI_AXIS = { usagePage: 0x01, usage: 0x08 }; // HID usage tables: a multi-axis controller
const FULL_COUNTS = 350; // of a cap that is pushed as far as it goes, on each axis of 3Dconnexion's devices
const FULL_DEG = 30; // of a phone that is tilted for the whole speed
const DEAD_DEG = 3;

export class KeyboardDevice {
  constructor() {
    this.name = "keys";
    this.side = SIDES[0];
    this.down = new Set();
  }

  // Returns whether the key is one of this device's.
  key(event, pressed) {
    if (!(event.code in STEPS)) return false;
    if (pressed) this.down.add(event.code);
    else this.down.delete(event.code);
    return true;
  }

  forget() {
    this.down.clear();
  }

  read() {
    if (this.down.size === 0) return null;
    const deflection = [0, 0, 0, 0, 0, 0];
    for (const code of this.down) deflection[STEPS[code][0]] += STEPS[code][1];
    return { [this.side]: deflection };
  }
}

export class GamepadDevice {
  constructor() {
    this.name = "gamepad";
  }

  get pad() {
    return [...navigator.getGamepads()].find((pad) => pad?.mapping === "standard") ?? null;
  }

  get clutch() {
    return this.pad?.buttons[CLUTCH_BUTTON].pressed ?? null;
  }

  // Whether the sticks turn the hands now.
  get turns() {
    return this.pad?.buttons[TURN_BUTTON].pressed ?? false;
  }

  // Sticks: away and sideways, the left one for the left hand; triggers: all hands up and down. While the right
  // shoulder is held they turn: a stick tips its hand over the way that it is pushed, the triggers about the vertical.
  read() {
    const pad = this.pad;
    if (!pad) return null;
    const stick = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : value);
    const rise = pad.buttons[UP_BUTTON].value - pad.buttons[DOWN_BUTTON].value;
    const moved = (across, along) => [-stick(along), -stick(across), rise, 0, 0, 0];
    const turned = (across, along) => [0, 0, 0, stick(across), -stick(along), rise];
    const hand = this.turns ? turned : moved;
    const deflections = SIDES.map((side) => [side, hand(...this.stick(pad, side))]);
    return deflections.some(([, deflection]) => deflection.some((value) => value !== 0)) ? Object.fromEntries(deflections) : null;
  }

  // x and y of the stick of a side.
  stick(pad, side) {
    return side === "left" ? [pad.axes[0], pad.axes[1]] : [pad.axes[2], pad.axes[3]];
  }

  // What each control does now, and how far it is pressed: for the page to show. at: x and y of a stick, or a share.
  get mapping() {
    const pad = this.pad;
    if (!pad) return [];
    const [tip, way] = this.turns ? ["tips over", "about the vertical"] : ["moves", "down and up"];
    const button = (index) => pad.buttons[index].value;
    const whose = SIDES.length === 2 ? "both" : "hand";
    return [
      { name: "LB", does: "clutch, held", at: button(CLUTCH_BUTTON) },
      { name: "RB", does: "turn, held", at: button(TURN_BUTTON) },
      ...SIDES.map((side) => ({ name: `${side} stick`, does: `${side} hand ${tip}`, at: this.stick(pad, side) })),
      { name: "LT", does: `${whose} ${way}`, at: button(DOWN_BUTTON) },
      { name: "RT", does: `${whose} ${way}`, at: button(UP_BUTTON) },
    ];
  }
}

// A cap with six axes, by WebHID. Report 1 has the translation, and on newer devices the rotation behind it, else report 2
// has that; report 3 has the buttons. Its axes: x to the right, y to the person, z down.
export class SpaceMouseDevice {
  constructor() {
    this.name = "SpaceMouse";
    this.side = SIDES[0];
    this.gone();
    if (!navigator.hid) return;
    navigator.hid.getDevices().then((known) => this.open(known));
    navigator.hid.addEventListener("disconnect", ({ device }) => device === this.device && this.gone());
  }

  gone() {
    this.device = null;
    this.axes = [0, 0, 0, 0, 0, 0];
    this.buttons = 0;
  }

  async find() {
    await this.open(await navigator.hid.requestDevice({ filters: [MULTI_AXIS] }));
  }

  async open(devices) {
    const is = ({ usagePage, usage }) => usagePage === MULTI_AXIS.usagePage && usage === MULTI_AXIS.usage;
    const device = devices.find(({ collections }) => collections.some(is));
    if (!device) return;
    if (!device.opened) await device.open();
    device.addEventListener("inputreport", (event) => this.take(event));
    this.device = device;
  }

  take({ reportId, data }) {
    if (reportId === 3) this.buttons = data.getUint8(0);
    const from = { 1: 0, 2: 3 }[reportId];
    if (from === undefined) return;
    const count = Math.min(6 - from, Math.floor(data.byteLength / 2));
    for (let k = 0; k < count; k += 1) this.axes[from + k] = data.getInt16(2 * k, true) / FULL_COUNTS;
  }

  get clutch() {
    return this.device && (this.buttons & 1) === 1;
  }

  read() {
    const [x, y, z, ofX, ofY, ofZ] = this.axes.map((value) => Math.max(-1, Math.min(1, Math.abs(value) < DEAD_ZONE ? 0 : value)));
    const deflection = [-y, -x, -z, -ofY, -ofX, -ofZ].map((value) => value + 0); // no -0
    return deflection.some((value) => value !== 0) ? { [this.side]: deflection } : null;
  }
}

// A phone that is held flat, by its orientation: what counts is how far it is tilted and twisted from where it was when the
// clutch began to be held. It moves the hand the way that it tips, and up when twisted to the left; or it turns the hand.
export class PhoneDevice {
  constructor() {
    this.name = "phone";
    this.side = SIDES[0];
    this.turns = false;
    this.now = this.from = null;
  }

  async find() {
    const granted = (await window.DeviceOrientationEvent?.requestPermission?.()) ?? "granted";
    if (granted !== "granted") throw new Error("the browser does not tell how this device is held");
    window.addEventListener("deviceorientation", ({ alpha, beta, gamma }) => {
      this.now = alpha === null ? null : [alpha, beta, gamma];
    });
  }

  forget() {
    this.from = null;
  }

  // How it is held, by which the console judges whether a hand turns it so: turns about z, x and y, one after the other
  // (https://www.w3.org/TR/orientation-event/).
  get sensed() {
    const [[cz, sz], [cx, sx], [cy, sy]] = this.now.map((deg) => [Math.cos((deg * Math.PI) / 360), Math.sin((deg * Math.PI) / 360)]);
    const wxyz = [cz * cx * cy - sz * sx * sy, cz * sx * cy - sz * cx * sy, cz * cx * sy + sz * sx * cy, cz * sx * sy + sz * cx * cy];
    return { [this.side]: [0, 0, 0, ...wxyz] };
  }

  read() {
    if (this.now === null) return null;
    this.from ??= this.now;
    const [twist, up, right] = this.now.map((value, k) => {
      const angle = ((value - this.from[k] + 540) % 360) - 180;
      return Math.abs(angle) < DEAD_DEG ? 0 : Math.max(-1, Math.min(1, angle / FULL_DEG));
    });
    const deflection = (this.turns ? [0, 0, 0, right, -up, twist] : [-up, -right, twist, 0, 0, 0]).map((value) => value + 0);
    return { [this.side]: deflection };
  }
}
