// Layouts under names, kept by the console for all pages: which signals, and which part of a log about its impact.

import { get, post, remove } from "../api.js";
import { showError } from "../errors.js";

export class Layouts {
  constructor(view, log) {
    Object.assign(this, { view, log });
    this.select = document.getElementById("layout");
    this.name = document.getElementById("layout-name");
    this.known = {};
    this.select.addEventListener("change", () => this.choose(this.select.value));
    document.getElementById("layout-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.keep(this.name.value.trim());
    });
    document.getElementById("layout-remove").addEventListener("click", () => this.forget(this.select.value));
  }

  async offer() {
    try {
      this.known = await get("/api/layouts");
    } catch (error) {
      showError(`The layouts are not known: ${error.message}`);
    }
    this.show(this.view.layout ?? "");
    if (this.view.layout) this.choose(this.view.layout);
  }

  show(name) {
    this.select.replaceChildren(new Option("Open a layout ...", ""), ...Object.keys(this.known).map((known) => new Option(known, known)));
    this.select.value = name in this.known ? name : "";
    document.getElementById("layout-remove").disabled = this.select.value === "";
  }

  // Of a layout's times: s, of the first impact, or of the first sample where there is none.
  get zero() {
    return this.log.impact ?? 0;
  }

  choose(name) {
    const layout = this.known[name];
    this.show(name);
    if (!layout) return name && showError(`There is no layout ${name}.`);
    const { view } = this;
    view.signals = layout.signals.filter((signal) => view.names.has(signal)); // it may be of another log
    for (const what of ["reference", "difference"]) view[what] = layout[what];
    document.getElementById("reference").checked = view.reference;
    document.getElementById("minus").checked = view.difference;
    if (layout.from_s === null || layout.to_s === null) view.setWindow(0, view.end);
    else view.setWindow(layout.from_s + this.zero, layout.to_s + this.zero);
    view.tell("signals");
    this.name.value = name;
    return layout;
  }

  async keep(name) {
    if (!name) return;
    const { signals, from, to, end, reference, difference } = this.view;
    const part = from > 0 || to < end;
    const layout = { signals, from_s: part ? from - this.zero : null, to_s: part ? to - this.zero : null, reference, difference };
    try {
      this.known[name] = await post(`/api/layouts/${encodeURIComponent(name)}`, layout);
      this.show(name);
    } catch (error) {
      showError(`The layout was not kept: ${error.message}`);
    }
  }

  async forget(name) {
    try {
      await remove(`/api/layouts/${encodeURIComponent(name)}`);
      delete this.known[name];
      this.show("");
    } catch (error) {
      showError(`The layout was not removed: ${error.message}`);
    }
  }
}
