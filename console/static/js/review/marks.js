// The list of events and notes: by severity, a click goes there; [ and ] go to the previous and the next one.

import { wordOf } from "../modes.js";

const LEVELS = ["DEBUG", "INFO", "WARNING", "ERROR", "FATAL"];
const MOST = 500; // rows: a browser lays out ten thousand slowly 
const SAME_S = 5e-4;

// An event as a sentence: a change of mode in the modes' words.
function sentence({ name, text }) {
  if (name === "note") return text;
  const said = name === "mode" ? text.split(" -> ").map((mode) => wordOf(mode.toUpperCase())).join(" to ") : text;
  return `${name[0].toUpperCase()}${name.slice(1)}: ${said}`;
}

export class Marks {
  constructor(view, log) {
    this.view = view;
    this.log = log;
    this.list = document.getElementById("log-events");
    this.level = document.getElementById("level");
    this.shown = [];
    this.known = -1;
    this.tools = () => []; // of a note: buttons beside it
    this.level.addEventListener("change", () => this.show());
    view.on("cursor", () => this.mark());
    new ResizeObserver(() => this.follow()).observe(this.list);
  }

  // The log has grown.
  update() {
    if (this.log.document.events.length === this.known) return;
    this.known = this.log.document.events.length;
    this.show();
  }

  show() {
    const least = LEVELS.indexOf(this.level.value);
    const events = this.log.marks.filter(({ level }) => level === "NOTE" || LEVELS.indexOf(level) >= least);
    let rows = 0;
    this.shown = events.filter(({ note }) => note || rows++ < MOST);
    this.list.replaceChildren(...this.shown.map((event) => this.row(event)));
    const count = document.getElementById("event-count");
    count.textContent = events.length > MOST ? `first ${MOST} of ${events.length}` : `${events.length}`;
    this.current = null;
    this.mark();
  }

  row(event) {
    const row = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    const at = document.createElement("span");
    at.className = "at";
    at.textContent = `${event.t_s.toFixed(3)} s`;
    const level = document.createElement("span");
    level.className = "level";
    level.dataset.level = event.level;
    level.textContent = event.level;
    const text = document.createElement("span");
    text.textContent = sentence(event);
    button.append(at, level, text);
    button.addEventListener("click", () => this.go(event));
    row.append(button);
    if (event.note) row.append(...this.tools(event.note));
    return row;
  }

  go(event) {
    const { from, to } = this.view;
    if (event.t_s < from || event.t_s > to) {
      const half = (to - from) / 2;
      this.view.setWindow(event.t_s - half, event.t_s + half);
    }
    this.view.setCursor(event.t_s);
  }

  step(direction) {
    const { t } = this.view;
    const next = direction > 0 ? this.shown.find((event) => event.t_s > t + SAME_S) : this.shown.findLast((event) => event.t_s < t - SAME_S);
    if (next) this.go(next);
  }

  // The newest event at the cursor.
  mark() {
    const place = this.shown.findLastIndex((event) => event.t_s <= this.view.t + SAME_S);
    if (place === this.current) return;
    this.list.querySelector("[aria-current]")?.removeAttribute("aria-current");
    const row = this.list.children[place];
    this.current = place;
    row?.setAttribute("aria-current", "true");
    this.follow();
  }

  // The list alone is scrolled to it; the page stays where it is.
  follow() {
    const row = this.list.children[this.current];
    if (!row) return;
    const [at, frame] = [row.getBoundingClientRect(), this.list.getBoundingClientRect()];
    this.list.scrollTop += Math.min(0, at.top - frame.top) + Math.max(0, at.bottom - frame.bottom);
  }
}
