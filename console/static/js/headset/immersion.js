// The time in which the headset is on: a session of WebXR, a picture after the other.

import { SIDES } from "../arms.js";
import { showError } from "../errors.js";
import { Controllers } from "./controllers.js";
import { Frames } from "./frames.js";
import { Room } from "./room.js";

const $ = (id) => document.getElementById(id);
const none = () => ({ left: new Set(), right: new Set() });

export class Immersion {
  // page: hears what hands say, and knows what is to be seen.
  constructor(page) {
    this.page = page;
    this.frames = new Frames();
    this.controllers = new Controllers(this.frames);
    this.session = null;
    this.down = none();
  }

  async find() {
    const { xr } = navigator;
    this.kind = null;
    for (const kind of ["immersive-ar", "immersive-vr"]) {
      if (this.kind === null && (await xr?.isSessionSupported(kind).catch(() => false))) this.kind = kind;
    }
    const why = window.isSecureContext ? "This browser has no headset." : "A headset needs HTTPS: start the stack with --https.";
    $("enter").disabled = this.kind === null;
    $("enter-why").textContent = this.kind === null ? why : "";
  }

  async enter() {
    try {
      const session = await navigator.xr.requestSession(this.kind, { requiredFeatures: ["local-floor"], optionalFeatures: ["hand-tracking"] });
      // the layer smoothes its own edges, and the canvas is not seen
      const gl = document.createElement("canvas").getContext("webgl", { xrCompatible: true, alpha: true, antialias: false });
      session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl) });
      session.addEventListener("end", () => this.left());
      session.addEventListener("visibilitychange", () => session.visibilityState !== "visible" && this.page.letGo(true));
      this.space = await session.requestReferenceSpace("local-floor");
      this.space.addEventListener("reset", () => this.page.letGo(true));
      [this.session, this.room] = [session, new Room(gl)];
      document.body.dataset.headset = "on";
      session.requestAnimationFrame((at, frame) => this.picture(at, frame));
    } catch (error) {
      showError(`The headset was not entered: ${error.message}.`);
    }
  }

  left() {
    this.page.letGo(true);
    this.session = null;
    delete document.body.dataset.headset;
  }

  picture(at, frame) {
    if (this.session === null) return;
    this.session.requestAnimationFrame((next, following) => this.picture(next, following));
    const { page } = this;
    const said = this.controllers.read(frame, this.space, at / 1000);
    this.align(said.points);
    page.hear({ ...said, pressed: this.newly(said.pressed) });
    const { state, lines, view } = page;
    const clear = this.kind === "immersive-ar" && state !== "fault";
    this.room.draw(frame, this.space, this.frames, { state, clear, lines, places: view?.places, picture: page.camera.stale ? null : page.camera.picture });
    if (view) page.commands.saw(view.number);
  }

  newly(pressed) {
    const before = this.down;
    this.down = pressed;
    const fresh = none();
    for (const side of ["left", "right"]) {
      for (const name of pressed[side]) if (!before[side].has(name)) fresh[side].add(name);
    }
    return fresh;
  }

  // The triggers of all hands that lead: the controllers are where the pads are.
  align(points) {
    const pads = this.page.view?.places?.pads;
    const all = SIDES.every((side) => points[side]);
    if (all && !this.aligning && pads) this.frames.align(SIDES.map((side) => points[side]), pads);
    this.aligning = all;
  }

  pulse(side, strength, ms) {
    for (const source of this.session?.inputSources ?? []) {
      if (source.handedness === side) source.gamepad?.hapticActuators?.[0]?.pulse(strength, ms);
    }
  }
}
