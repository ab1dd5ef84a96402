// Devices beside the gizmos. Each has a name and `read()`: {left: [6], right: [6]}, from -1 to 1 along the world's axes
// and about them, or null while it asks for nothing. A VR controller would be one more, with poses instead.

const STEPS = { KeyW: [0, 1], KeyS: [0, -1], KeyA: [1, 1], KeyD: [1, -1], KeyE: [2, 1], KeyQ: [2, -1] };
const DEAD_ZONE = 0.12;
const CLUTCH_BUTTON = 4; // the left shoulder
const DOWN_BUTTON = 6;
const UP_BUTTON = 7;

export class KeyboardDevice {
  constructor() {
    this.name = "keys";
    this.side = "left";
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
    return this.pad?.buttons[CLUTCH_BUTTON].pressed ?? false;
  }

  // Sticks: away and sideways, the left one for the left hand; triggers: both hands up and down.
  read() {
    const pad = this.pad;
    if (!pad) return null;
    const stick = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : value);
    const rise = pad.buttons[UP_BUTTON].value - pad.buttons[DOWN_BUTTON].value;
    const hand = (across, along) => [-stick(along), -stick(across), rise, 0, 0, 0];
    const [left, right] = [hand(pad.axes[0], pad.axes[1]), hand(pad.axes[2], pad.axes[3])];
    return [...left, ...right].some((value) => value !== 0) ? { left, right } : null;
  }
}
