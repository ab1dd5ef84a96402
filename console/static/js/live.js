// The live state: one WebSocket, and an honest age that goes on counting when nothing arrives. The operator who has control
// answers each view once it is shown, and a worker does while the page is busy: a closed or broken page gives no sign of life.

import { csrf } from "./api.js";

const RETRY_MS = 1000;
const QUIET_S = 1.5; // nothing from the console for longer: nothing can be started from here
const BEAT_MS = 500;
const UNAUTHORIZED = 401;
const ENDING = 1012; // as uvicorn closes its connections when the console ends

export class Live {
  constructor() {
    this.view = null;
    this.receivedMs = null;
    this.listeners = [];
    this.ending = false;
    this.beats = null;
    this.beatMs = 0;
    this.connect();
    setInterval(() => this.watch(), BEAT_MS);
    document.addEventListener("freeze", () => this.say("asleep"));
    document.addEventListener("resume", () => this.say("awake"));
  }

  onView(listener) {
    this.listeners.push(listener);
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket = socket;
    socket.addEventListener("message", (message) => {
      this.receivedMs = performance.now();
      this.ending = false;
      this.show(JSON.parse(message.data));
      if (this.view.status?.holder === this.view.you) this.beat();
    });
    socket.addEventListener("close", ({ code }) => {
      this.ending ||= code === ENDING;
      this.signInAgain();
      setTimeout(() => this.connect(), RETRY_MS);
    });
  }

  show(view) {
    this.view = view;
    for (const listener of this.listeners) listener(view);
  }

  beat() {
    this.socket.send("beat");
    if (performance.now() - this.beatMs < BEAT_MS) return;
    this.beatMs = performance.now();
    this.beats ??= new Worker(new URL("./beats.js", import.meta.url));
    this.beats.postMessage(csrf);
  }

  // What the page showed last is not true any more once the console is quiet.
  watch() {
    if (this.view === null || this.since() < QUIET_S) return;
    const last = this.view.unreachable ?? "";
    const unreachable = last.startsWith("The robot process ended") ? last : this.ending ? "The stack has ended. Start `rtstack up` again; this page then goes on."
      : "The console does not answer. Check the network and the terminal of `rtstack up`; this page tries again.";
    const state = { word: "waiting", held_n: null, active: true, remedy: null };
    if (this.view.unreachable !== unreachable) this.show({ ...this.view, unreachable, state });
  }

  // A console that was restarted may not know this browser: its page says how to sign in, and keeps STOP.
  async signInAgain() {
    const answer = await fetch("/api/me").catch(() => null);
    if (answer?.status === UNAUTHORIZED) location.reload();
  }

  // Send a word where the socket is open.
  say(word) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(word);
  }

  // Age of what is on screen, s: as old as the console says, and older by the time since it said so.
  since() {
    return this.receivedMs === null ? Infinity : (performance.now() - this.receivedMs) / 1000;
  }

  ageOf(arm) {
    return this.view === null ? Infinity : this.view[arm].age_s + this.since();
  }
}
