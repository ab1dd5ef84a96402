// The live state: one WebSocket, and an honest age that goes on counting when nothing arrives. The operator who has control
// answers each view once it is shown: a page that is closed, frozen or broken gives no sign of life.

import { showError } from "./errors.js";

const RETRY_MS = 1000;
const SIGNED_OUT = 1008;

export class Live {
  constructor() {
    this.view = null;
    this.receivedMs = null;
    this.listeners = [];
    this.connect();
  }

  onView(listener) {
    this.listeners.push(listener);
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket = socket;
    socket.addEventListener("message", (message) => {
      this.view = JSON.parse(message.data);
      this.receivedMs = performance.now();
      for (const listener of this.listeners) listener(this.view);
      if (this.view.status?.holder === this.view.you) socket.send("beat");
    });
    socket.addEventListener("close", ({ code }) => {
      if (code === SIGNED_OUT) showError("This browser is not signed in any more: STOP still works, nothing else. Reload the page to see how to sign in.");
      setTimeout(() => this.connect(), RETRY_MS);
    });
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
