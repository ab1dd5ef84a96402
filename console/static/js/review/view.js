// What the page shows: signals, window, cursor. Kept in the address, so that a link opens exactly this view.

const DEFAULT = [
  "left.pad_force", "right.pad_force", "left.force_norm", "left.pad_velocity.vy", "right.pad_velocity.vy",
  "object.position.z",
];
export const MOST_OTHERS = 5;
const ADDRESS_MS = 300; // browsers refuse more than some hundred changes of the address in ten seconds
const SHORTEST_S = 0.005;

export class View {
  constructor() {
    const asked = new URLSearchParams(location.search);
    const number = (key) => (Number.isFinite(parseFloat(asked.get(key))) ? parseFloat(asked.get(key)) : null);
    this.signals = asked.has("signals") ? asked.get("signals").split(",").filter(Boolean) : [...DEFAULT];
    this.t = number("t") ?? 0;
    this.placed = asked.has("t"); // whether a person has said where the cursor is
    this.from = number("from");
    this.to = number("to");
    this.others = (asked.get("other") ?? "").split(",").filter(Boolean).slice(0, MOST_OTHERS);
    this.reference = asked.get("reference") === "1";
    this.difference = asked.get("difference") === "1";
    this.across = asked.get("x"); // the signal along the horizontal axis, null: time
    this.layout = asked.get("layout"); // to be applied once
    this.align = asked.get("align") === "start" ? "start" : "impact";
    this.end = 1;
    this.known = false;
    this.listeners = { cursor: [], window: [], signals: [], other: [] };
    this.timer = null;
  }

  on(what, listener) {
    this.listeners[what].push(listener);
  }

  tell(what) {
    for (const listener of this.listeners[what]) listener(this);
    if (this.timer === null) this.timer = setTimeout(() => this.writeAddress(), ADDRESS_MS);
  }

  // The log's length is known, or has grown.
  setEnd(end) {
    const whole = this.to === null || (this.known && this.to >= this.end);
    this.known = true;
    this.end = Math.max(end, 0.001);
    this.setWindow(this.from ?? 0, whole ? this.end : this.to);
    this.setCursor(this.t);
  }

  setCursor(t) {
    if (!this.known) return; // no movement before the length is known
    this.t = Math.min(Math.max(t, 0), this.end);
    this.tell("cursor");
  }

  setWindow(from, to) {
    if (!this.known) return;
    const length = Math.min(Math.max(to - from, SHORTEST_S), this.end);
    const start = Math.min(Math.max(from, 0), this.end - length);
    if (this.from === start && this.to === start + length) return;
    [this.from, this.to] = [start, start + length];
    this.tell("window");
  }

  zoom(factor) {
    if (!this.known) return;
    const t = this.t >= this.from && this.t <= this.to ? this.t : (this.from + this.to) / 2;
    this.setWindow(t - (t - this.from) * factor, t + (this.to - t) * factor);
  }

  // Nothing is asked for that the log cannot have.
  keep(names) {
    this.names = names;
    const instead = (name) => (names.has(name) ? name : name.replace(/^left\./, "right.")); // of the arm that is there
    this.signals = [...new Set(this.signals.map(instead))].filter((name) => names.has(name));
    if (!names.has(this.across)) this.across = null;
  }

  toggle(name, on) {
    this.signals = on ? [...this.signals, name] : this.signals.filter((signal) => signal !== name);
    this.tell("signals");
  }

  // what: reference, difference or across.
  show(what, on) {
    this[what] = on;
    this.tell("signals");
  }

  writeAddress() {
    this.timer = null;
    const parts = [`t=${this.t.toFixed(3)}`, `signals=${this.signals.join(",")}`];
    if (this.from > 0 || this.to < this.end) parts.push(`from=${this.from.toFixed(3)}`, `to=${this.to.toFixed(3)}`);
    if (this.others.length) parts.push(`other=${this.others.join(",")}`, `align=${this.align}`);
    if (this.across) parts.push(`x=${this.across}`);
    for (const what of ["reference", "difference"]) if (this[what]) parts.push(`${what}=1`);
    history.replaceState(null, "", `?${parts.join("&")}`);
  }
}
