// The tree of signals: arm, field, component; a search; the same tick boxes for keyboard and mouse.

import { wordsOf } from "./values.js";

export class Tree {
  constructor(view, signals) {
    this.view = view;
    this.place = document.getElementById("tree");
    this.search = document.getElementById("signal-search");
    this.boxes = new Map();
    this.across = document.getElementById("across");
    this.across.addEventListener("change", () => view.show("across", this.across.value || null));
    this.place.hidden = true; // until it is known which arms the log has
    this.build(signals);
    this.search.addEventListener("input", () => this.filter());
    view.on("signals", () => this.tick());
    this.tick(true);
  }

  build(signals) {
    const groups = Map.groupBy(signals, (signal) => signal.group);
    for (const [group, members] of groups) {
      const details = this.branch("group", group, "");
      details.open = true;
      for (const [field, components] of Map.groupBy(members, (signal) => signal.field)) {
        const unit = [...new Set(components.map((signal) => signal.unit).filter(Boolean))].join(", ");
        const [{ plain }] = components;
        if (components.length === 1 && components[0].component === "") {
          const leaf = document.createElement("div");
          leaf.className = "field";
          leaf.append(this.leaf(components[0], plain));
          details.append(leaf);
          continue;
        }
        const inner = this.branch("field", plain, unit);
        inner.title = field;
        const row = document.createElement("div");
        row.className = "components";
        row.append(...components.map((signal) => this.leaf(signal, signal.component)));
        inner.append(row);
        details.append(inner);
      }
      this.place.append(details);
    }
  }

  // What can be the horizontal axis: time, or a signal.
  offer(signals) {
    for (const [group, members] of Map.groupBy(signals, (signal) => signal.group)) {
      const place = Object.assign(document.createElement("optgroup"), { label: group });
      place.append(...members.map((signal) => new Option(wordsOf(signal), signal.name)));
      this.across.append(place);
    }
    this.across.value = this.view.across ?? "";
  }

  // Show what the log can have, and nothing else.
  keep(names) {
    for (const [name, { label }] of this.boxes) {
      if (names.has(name)) continue;
      label.remove();
      this.boxes.delete(name);
    }
    for (const kind of [".field", ".group"]) {
      for (const element of this.place.querySelectorAll(kind)) if (element.querySelector("label") === null) element.remove();
    }
    this.place.hidden = false;
  }

  branch(kind, text, unit) {
    const details = document.createElement("details");
    details.className = kind;
    const summary = document.createElement("summary");
    const small = document.createElement("small");
    small.textContent = unit ? ` ${unit}` : "";
    summary.append(text, small);
    details.append(summary);
    return details;
  }

  leaf(signal, text) {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.addEventListener("change", () => this.view.toggle(signal.name, box.checked));
    label.append(box, text);
    label.title = signal.unit ? `${signal.name}, ${signal.unit}` : signal.name;
    this.boxes.set(signal.name, { box, label, words: `${signal.name} ${signal.plain}`.toLowerCase() });
    return label;
  }

  tick(open = false) {
    for (const [name, { box }] of this.boxes) {
      box.checked = this.view.signals.includes(name);
      const field = box.closest("details.field");
      if (open && box.checked && field) field.open = true;
    }
  }

  filter() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const { label, words: known } of this.boxes.values()) label.hidden = !words.every((word) => known.includes(word));
    for (const element of this.place.querySelectorAll(".field, .group")) {
      element.hidden = element.querySelector("label:not([hidden])") === null;
      if (words.length && element.matches("details.field")) element.open = !element.hidden;
    }
  }
}
