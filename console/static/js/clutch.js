// The clutch of real arms on the pages without the panel of the hand: a run moves only while the button, or C, is held.

import { Commands } from "./commands.js";
import { isTextField } from "./stop.js";

const BEAT_MS = 50;
const ACTIVE = new Set(["starting", "running"]);

export function startClutch(live) {
  const button = document.getElementById("hold");
  if (button === null) return;
  const commands = new Commands(live);
  let socket = null;
  let beat = null;
  const say = (message) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));
  const press = () => {
    if (button.hidden || beat !== null) return;
    button.dataset.state = "held";
    beat = setInterval(() => say(commands.stamped({ clutch: true })), BEAT_MS);
  };
  const letGo = (lost) => {
    if (beat === null) return;
    clearInterval(beat);
    beat = null;
    button.dataset.state = "";
    say({ clutch: false, lost });
  };
  const connect = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/teleoperation/hand`);
    socket.addEventListener("close", () => {
      letGo(true);
      socket = null; // the next view that needs it connects again
    });
  };
  live.onView(({ status }) => {
    const job = status?.job;
    const needed = Boolean(job) && ACTIVE.has(job.state) && job.kind !== "teleoperation" && !job.title.endsWith(", shadow");
    button.hidden = !needed;
    if (needed && socket === null) connect();
    if (!needed) letGo(false);
  });
  button.addEventListener("pointerdown", (event) => {
    button.setPointerCapture(event.pointerId);
    press();
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(name, () => letGo(false));
  window.addEventListener("keydown", (event) => {
    if (event.code === "KeyC" && !event.repeat && !isTextField(event.target) && !(event.ctrlKey || event.altKey || event.metaKey)) press();
  });
  window.addEventListener("keyup", (event) => event.code === "KeyC" && letGo(false));
  window.addEventListener("blur", () => letGo(true));
  window.addEventListener("pagehide", () => letGo(true));
  document.addEventListener("visibilitychange", () => document.hidden && letGo(true));
}
