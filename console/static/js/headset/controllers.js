// What is in a person's hands, from WebXR's input sources: where each is in the world, and what is pressed. Without
// controllers a pinch of thumb and index finger is the grip.

import { SIDES } from "../arms.js";
import { OneEuro } from "./one_euro.js";

// https://www.w3.org/TR/webxr-gamepads-module-1/, xr-standard
const [TRIGGER, SQUEEZE, STICK, LOWER, UPPER] = [0, 1, 3, 4, 5];
const PINCHED_M = 0.015;
const OPEN_M = 0.03;
export const LEAST_HZ = 6;
export const PER_M_S = 20;

// Of each arm of the cell: the hand of the same side leads it.
const ofSides = (make) => Object.fromEntries(SIDES.map((side) => [side, make()]));

export class Controllers {
  constructor(frames) {
    this.frames = frames;
    this.filters = ofSides(() => new OneEuro(LEAST_HZ, PER_M_S));
    this.held = ofSides(() => false);
    this.must = ofSides(() => true); // be let go before it can hold
    this.pinched = ofSides(() => false);
  }

  // What a frame shows: hands (7 numbers each, null for one that leads nothing), sensed: the same before their filter, by
  // which the console judges whether a hand moves so; gripped: any grip is held; lost: one that led is not seen any more;
  // pressed: of each controller, also of one that leads no arm, the names of its buttons; points: where controllers are whose trigger is pulled, in the room.
  read(frame, space, atS) {
    const said = { hands: ofSides(() => null), sensed: ofSides(() => null), gripped: false, lost: false, pressed: { left: new Set(), right: new Set() }, points: {} };
    const seen = new Set();
    for (const source of frame.session.inputSources) {
      const side = source.handedness;
      if (!(side in said.pressed) || !(source.hand || (source.gamepad && source.gripSpace))) continue;
      if (!(side in said.hands)) {
        if (!source.hand) for (const name of this.controller(frame, space, source).down) said.pressed[side].add(name);
        continue;
      }
      seen.add(side);
      this.take(side, source.hand ? this.finger(frame, space, side, source.hand) : this.controller(frame, space, source), said, atS);
    }
    for (const side of SIDES) {
      if (seen.has(side)) continue;
      said.lost ||= this.held[side];
      this.forget(side, true);
    }
    return said;
  }

  controller(frame, space, { gamepad: { buttons }, gripSpace }) {
    const down = [[TRIGGER, "trigger"], [STICK, "stick"], [LOWER, "lower"], [UPPER, "upper"]].filter(([index]) => buttons[index]?.pressed);
    return { gripped: Boolean(buttons[SQUEEZE]?.pressed), pose: frame.getPose(gripSpace, space), down: down.map(([, name]) => name) };
  }

  finger(frame, space, side, hand) {
    const joint = (name) => frame.getJointPose?.(hand.get(name), space);
    const [thumb, index] = [joint("thumb-tip"), joint("index-finger-tip")].map((pose) => pose?.transform.position);
    const apart = thumb && index ? Math.hypot(thumb.x - index.x, thumb.y - index.y, thumb.z - index.z) : Infinity;
    this.pinched[side] = apart < (this.pinched[side] ? OPEN_M : PINCHED_M);
    return { gripped: this.pinched[side], pose: joint("wrist"), down: [] };
  }

  take(side, { gripped, pose, down }, said, atS) {
    for (const name of down) said.pressed[side].add(name);
    if (!gripped) this.must[side] = false;
    said.gripped ||= gripped;
    const usable = pose && !pose.emulatedPosition;
    if (usable && !gripped && said.pressed[side].has("trigger")) said.points[side] = pose.transform.position;
    if (!gripped || this.must[side] || !usable) {
      said.lost ||= this.held[side] && gripped;
      this.forget(side, gripped);
      return;
    }
    const { position, orientation } = pose.transform;
    this.held[side] = true;
    const [place, turn] = [this.frames.place(position), [orientation.w, ...this.frames.direction(orientation)]];
    said.sensed[side] = [...place, ...turn];
    said.hands[side] = [...this.filters[side].filter(place, atS), ...turn];
  }

  forget(side, gripped) {
    this.held[side] = false;
    this.must[side] ||= gripped;
    this.filters[side].forget();
  }

  forgetAll() {
    for (const side of SIDES) this.forget(side, true);
  }
}
