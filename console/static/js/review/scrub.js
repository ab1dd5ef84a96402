// The cursor on the server: it moves the arms of this page's own scene, and tells what the signals are there.
// One question at a time, always the newest one: a drag is never behind.

const RETRY_MS = 1000;

export class Scrub {
  // ghost: gives {id, offset} of the second log that is shown at the same moment, or null
  constructor(view, log, ghost, onValues) {
    this.view = view;
    this.ghost = ghost;
    this.key = crypto.randomUUID();
    this.address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/logs/${log.id}/scrub?view=${this.key}`;
    this.onValues = onValues;
    this.asked = null;
    this.wanted = false;
    view.on("cursor", () => this.ask());
    view.on("signals", () => this.ask());
    view.on("other", () => this.ask());
    this.connect();
  }

  connect() {
    this.socket = new WebSocket(this.address);
    this.socket.addEventListener("open", () => this.ask());
    this.socket.addEventListener("message", (message) => {
      const answer = JSON.parse(message.data);
      performance.measure("scrub", { start: this.asked ?? performance.now(), end: performance.now() });
      this.asked = null;
      if (!answer.error) this.onValues(answer);
      if (this.wanted) this.ask();
    });
    this.socket.addEventListener("close", () => {
      this.asked = null;
      setTimeout(() => this.connect(), RETRY_MS);
    });
  }

  ask() {
    this.wanted = this.socket?.readyState !== WebSocket.OPEN || this.asked !== null;
    if (this.wanted) return;
    this.asked = performance.now();
    const ghost = this.ghost();
    const other = ghost === null ? {} : { other: ghost.id, offset: ghost.offset };
    this.socket.send(JSON.stringify({ t: this.view.t, signals: this.view.signals.join(","), ...other }));
  }
}
