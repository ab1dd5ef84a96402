// What the signals are at the cursor, in this log and in each log over it: a table, while logs are compared.

import { valueText } from "./legends.js";
import { overlaySwatch } from "./style.js";

const DIGITS = 3;

function cell(row, kind, text) {
  const made = document.createElement(kind);
  made.append(text);
  row.append(made);
  return made;
}

export const wordsOf = ({ whose, component, plain }) => [whose, component, plain].filter(Boolean).join(" ");

export class Values {
  // nameOf: of a compared log, by its id
  constructor(nameOf) {
    this.nameOf = nameOf;
    this.section = document.getElementById("values");
    this.table = this.section.querySelector("table");
    this.written = [];
  }

  // A row for each signal of signals, a column for each log.
  show(signals, others) {
    this.section.hidden = others.length === 0;
    if (this.section.hidden) return;
    const [head, body] = [this.table.tHead.rows[0], this.table.tBodies[0]];
    head.replaceChildren();
    cell(head, "th", "");
    cell(head, "th", "this log");
    others.forEach(({ log, place }) => {
      const heading = cell(head, "th", overlaySwatch(place));
      heading.scope = "col";
      heading.title = this.nameOf(log.id);
      heading.ariaLabel = heading.title;
    });
    this.written = [];
    body.replaceChildren(...signals.map((signal) => {
      const row = document.createElement("tr");
      const name = cell(row, "th", wordsOf(signal));
      name.scope = "row";
      name.title = signal.unit ? `${signal.name}, ${signal.unit}` : signal.name;
      this.written.push([signal.name, [null, ...others].map(() => cell(row, "td", ""))]);
      return row;
    }));
  }

  // values: of each log, this one first, by signal. t: s
  write(values, t) {
    if (this.section.hidden) return;
    this.table.tHead.rows[0].cells[0].textContent = `at ${t.toFixed(3)} s`;
    for (const [name, cells] of this.written) cells.forEach((each, place) => (each.textContent = valueText(values[place]?.[name], DIGITS)));
  }
}
