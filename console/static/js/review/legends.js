// The legends on top of the panes: what each curve is, and its value at the cursor.

import { dashOf } from "./style.js";

const KEYS = { dash: "6 3", dot: "2 2", solid: "none" };

export class Legends {
  constructor() {
    this.place = document.getElementById("legends");
    this.shown = "";
    this.heights = []; // px, of each legend
    this.tops = "";
    this.written = new Map();
    this.writtenOther = new Map();
    this.values = [{}, null];
  }

  // Write the legends of fields, [signals], for two logs where `compared`, and return how high each is in an area that is
  // `width` px wide. colour: of a signal. What has not changed is left alone: the page need not be laid out.
  show(fields, colour, compared, width, differs = false) {
    const shown = JSON.stringify([fields.map((members) => members.map((signal) => [signal.name, colour(signal)])), compared, width, differs]);
    if (shown === this.shown) return this.heights;
    this.shown = shown;
    this.tops = "";
    this.written.clear();
    this.writtenOther.clear();
    this.place.replaceChildren(...fields.map((members) => {
      const legend = document.createElement("div");
      legend.className = "legend";
      const title = document.createElement("b");
      const [{ plain, field }] = members;
      const units = [...new Set(members.map(({ unit }) => unit).filter(Boolean))].join(", ");
      title.textContent = `${differs ? "difference of " : ""}${plain}${units ? `, ${units}` : ""}`;
      const name = document.createElement("span");
      name.className = "faint";
      name.textContent = field;
      legend.append(title, name, ...members.map((signal) => this.entry(signal, colour(signal), compared, signal.field === field ? "" : " reference")));
      return legend;
    }));
    this.showValues(...this.values);
    this.heights = [...this.place.children].map((legend) => legend.offsetHeight);
    return this.heights;
  }

  // tops: px, of each legend.
  move(tops) {
    if (`${tops}` === this.tops) return;
    this.tops = `${tops}`;
    tops.forEach((top, row) => (this.place.children[row].style.top = `${top}px`));
  }

  entry(signal, colour, compared, end) {
    const entry = document.createElement("span");
    entry.className = "entry";
    entry.innerHTML = '<svg viewBox="0 0 20 8" aria-hidden="true"><line x1="0" x2="20" y1="4" y2="4" stroke-width="2.5"/></svg>';
    const line = entry.querySelector("line");
    line.setAttribute("stroke", colour);
    line.setAttribute("stroke-dasharray", KEYS[dashOf(signal)]);
    const value = document.createElement("span");
    value.className = "value";
    this.written.set(signal.name, value);
    entry.append((signal.component ? `${signal.whose} ${signal.component}` : signal.whose) + end, value);
    if (!compared) return entry;
    const other = document.createElement("span");
    other.className = "value faint";
    other.title = "The compared log at the same moment";
    this.writtenOther.set(signal.name, other);
    entry.append(other);
    return entry;
  }

  // What the curves are at the cursor, as the server has it: exact, not what a pixel can tell.
  showValues(values, others = null) {
    this.values = [values, others];
    const text = (value) => (value === undefined ? "" : value === null ? "none" : digits(value));
    for (const [name, element] of this.written) element.textContent = text(values[name]);
    for (const [name, element] of this.writtenOther) element.textContent = text(others?.[name]);
  }
}

function digits(value) {
  const size = Math.abs(value);
  return value.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : size >= 1 ? 3 : 4);
}
