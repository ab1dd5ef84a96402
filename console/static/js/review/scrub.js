// The cursor on the server: it moves the arms of this page's own scene, and tells what the signals are there.
// One question at a time, always the newest one: a drag is never behind.

const RETRY_MS = 1000;

export class Scrub {
  // compared: gives the logs over this one, [{id, offset}], and whether the first one is in the scene as a ghost
  constructor(view, log, compared, onValues) {
    this.view = view;
    this.compared = compared;
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
    const { others, ghost } = this.compared();
    this.socket.send(JSON.stringify({ t: this.view.t, signals: this.view.signals.join(","), others: others.map(({ id, offset }) => `${id}:${offset}`).join(","), ghost }));
  }
}
