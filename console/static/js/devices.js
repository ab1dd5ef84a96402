// Devices beside the gizmos. Each has a name and `read()`: {left: [6], right: [6]}, from -1 to 1 along the world's axes
// and about them, or null while it asks for nothing. A VR controller would be one more, with poses instead.

const STEPS = {
  KeyW: [0, 1], KeyS: [0, -1], KeyA: [1, 1], KeyD: [1, -1], KeyE: [2, 1], KeyQ: [2, -1], // along x, y, z
  KeyL: [3, 1], KeyJ: [3, -1], KeyI: [4, 1], KeyK: [4, -1], KeyU: [5, 1], KeyO: [5, -1], // about x, y, z
};
const DEAD_ZONE = 0.12;
const CLUTCH_BUTTON = 4; // the left shoulder
const TURN_BUTTON = 5; // the right one
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

  // Whether the sticks turn the hands now.
  get turns() {
    return this.pad?.buttons[TURN_BUTTON].pressed ?? false;
  }

  // Sticks: away and sideways, the left one for the left hand; triggers: both hands up and down. While the right
  // shoulder is held they turn: a stick tips its hand over the way that it is pushed, the triggers about the vertical.
  read() {
    const pad = this.pad;
    if (!pad) return null;
    const stick = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : value);
    const rise = pad.buttons[UP_BUTTON].value - pad.buttons[DOWN_BUTTON].value;
    const moved = (across, along) => [-stick(along), -stick(across), rise, 0, 0, 0];
    const turned = (across, along) => [0, 0, 0, stick(across), -stick(along), rise];
    const hand = this.turns ? turned : moved;
    const [left, right] = [hand(pad.axes[0], pad.axes[1]), hand(pad.axes[2], pad.axes[3])];
    return [...left, ...right].some((value) => value !== 0) ? { left, right } : null;
  }

  // What each control does now, and how far it is pressed: for the page to show. at: x and y of a stick, or a share.
  get mapping() {
    const pad = this.pad;
    if (!pad) return [];
    const [tip, way] = this.turns ? ["tips over", "about the vertical"] : ["moves", "down and up"];
    const button = (index) => pad.buttons[index].value;
    return [
      { name: "LB", does: "clutch, held", at: button(CLUTCH_BUTTON) },
      { name: "RB", does: "turn, held", at: button(TURN_BUTTON) },
      { name: "left stick", does: `left hand ${tip}`, at: [pad.axes[0], pad.axes[1]] },
      { name: "right stick", does: `right hand ${tip}`, at: [pad.axes[2], pad.axes[3]] },
      { name: "LT", does: `both ${way}`, at: button(DOWN_BUTTON) },
      { name: "RT", does: `both ${way}`, at: button(UP_BUTTON) },
    ];
  }
}
