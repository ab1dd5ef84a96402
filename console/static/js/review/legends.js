// The legends on top of the panes: what each curve is, and its value at the cursor.

import { dashOf, swatch } from "./style.js";

export class Legends {
  constructor() {
    this.place = document.getElementById("legends");
    this.shown = "";
    this.heights = []; // px, of each legend
    this.tops = "";
    this.written = new Map();
    this.values = {};
  }

  // Write the legends of fields, [signals], and return how high each is in an area that is `width` px wide. colour: of a
  // signal. What has not changed is left alone: the page need not be laid out.
  show(fields, colour, width, differs = false) {
    const shown = JSON.stringify([fields.map((members) => members.map((signal) => [signal.name, colour(signal)])), width, differs]);
    if (shown === this.shown) return this.heights;
    this.shown = shown;
    this.tops = "";
    this.written.clear();
    this.place.replaceChildren(...fields.map((members) => {
      const legend = document.createElement("div");
      legend.className = "legend";
      const title = document.createElement("b");
      const [{ plain, field }] = members;
      const units = [...new Set(members.map(({ unit }) => unit).filter(Boolean))].join(", ");
      title.textContent = `${differs ? "difference of " : ""}${plain}${units ? `, ${units}` : ""}`;
      title.title = field;
      const name = document.createElement("span");
      name.className = "faint";
      name.textContent = plain.startsWith(field.replaceAll("_", " ")) ? "" : field;
      legend.append(title, name, ...members.map((signal) => this.entry(signal, colour(signal), signal.field === field ? "" : " reference")));
      return legend;
    }));
    this.showValues(this.values);
    this.heights = [...this.place.children].map((legend) => legend.offsetHeight);
    return this.heights;
  }

  // tops: px, of each legend.
  move(tops) {
    if (`${tops}` === this.tops) return;
    this.tops = `${tops}`;
    tops.forEach((top, row) => (this.place.children[row].style.top = `${top}px`));
  }

  entry(signal, colour, end) {
    const entry = document.createElement("span");
    entry.className = "entry";
    const value = document.createElement("span");
    value.className = "value";
    this.written.set(signal.name, value);
    entry.append(swatch(dashOf(signal), colour), (signal.component ? `${signal.whose} ${signal.component}` : signal.whose) + end, value);
    return entry;
  }

  // What the curves are at the cursor, as the server has it: exact, not what a pixel can tell.
  showValues(values) {
    this.values = values;
    for (const [name, element] of this.written) element.textContent = valueText(values[name], 4);
  }
}

// With so many significant digits.
export function valueText(value, most) {
  if (value === undefined || value === null) return value === null ? "none" : "";
  const whole = Math.floor(Math.log10(Math.max(Math.abs(value), 1))) + 1;
  return value.toFixed(Math.max(0, most - (Math.abs(value) < 1 ? 0 : whole))).replace(/^-(?=[0.]*$)/, "");
}
