// What the mouse does in the curves: a click sets the cursor, a drag zooms to what it passes over, a drag on the cursor
// moves it; the wheel zooms about the pointer, with Shift or sideways it moves the window; a double click: all of it.

import { MARGIN } from "./chart.js";

const CLICK_PX = 4;
const WHEEL_PX = 200; // of the wheel for a factor of two: two notches of a mouse
const PAN_SHARE = 0.25; // of the window, for as much

export class Pointer {
  // area: what the curves are in; time: (px, event) -> s; zooms: whether a drag is a part of the time
  constructor(view, area, time, zooms = () => true) {
    Object.assign(this, { view, area, time, zooms });
    this.cursor = area.querySelector(".cursor"); // there may be none to drag
    this.selection = area.querySelector(".selection");
    this.from = null; // px, where a drag began
    area.addEventListener("pointerdown", (event) => this.down(event));
    area.addEventListener("pointermove", (event) => this.move(event));
    area.addEventListener("pointerup", (event) => this.up(event));
    area.addEventListener("pointercancel", () => this.end());
    area.addEventListener("dblclick", () => view.setWindow(0, view.end));
    area.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  place(event) {
    const { left, width } = this.area.getBoundingClientRect();
    return Math.min(Math.max(event.clientX - left, MARGIN.left), width - MARGIN.right);
  }

  down(event) {
    if (event.button !== 0) return;
    event.target.setPointerCapture(event.pointerId);
    if (event.target !== this.cursor) this.from = this.place(event);
  }

  move(event) {
    const place = this.place(event);
    if (this.cursor?.hasPointerCapture(event.pointerId)) this.view.setCursor(this.time(place, event));
    if (this.from === null || !this.zooms()) return;
    const [left, width] = [Math.min(this.from, place), Math.abs(place - this.from)];
    this.selection.hidden = width < CLICK_PX;
    this.selection.style.left = `${left}px`;
    this.selection.style.width = `${width}px`;
  }

  up(event) {
    if (this.from === null) return;
    const [first, last] = [this.from, this.place(event)].sort((a, b) => a - b);
    this.end();
    if (last - first < CLICK_PX || !this.zooms()) this.view.setCursor(this.time(this.place(event), event));
    else this.view.setWindow(this.time(first), this.time(last));
  }

  end() {
    this.from = null;
    this.selection.hidden = true;
  }

  wheel(event) {
    event.preventDefault();
    const { from, to } = this.view;
    const sideways = event.deltaX || (event.shiftKey ? event.deltaY : 0);
    const by = (pixels) => (pixels * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1)) / WHEEL_PX;
    if (sideways) {
      const step = by(sideways) * PAN_SHARE * (to - from);
      this.view.setWindow(from + step, to + step);
      return;
    }
    const about = Math.min(Math.max(this.time(this.place(event), event), from), to);
    const factor = 2 ** Math.min(Math.max(by(event.deltaY), -1), 1);
    this.view.setWindow(about - (about - from) * factor, about + (to - about) * factor);
  }
}
