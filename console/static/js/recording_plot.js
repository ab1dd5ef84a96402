// One plot of a recording: its curves, what is marked in time, and the values where the pointer is. It zooms as a log's
// review does: a drag, the wheel, a double click for all of it.

import { pen } from "./canvas.js";
import { Chart, MARGIN } from "./review/chart.js";
import { Pointer } from "./review/pointer.js";
import { token } from "./theme.js";

const SHORTEST_S = 0.005;
const TOP_PX = 6;

export class RecordingPlot {
  // area: what the canvas is in; its figure has the output for the values
  constructor(area) {
    this.area = area;
    this.values = area.parentElement.querySelector("output");
    this.t = []; // s
    new Pointer(this, area, (px) => this.timeAt(px));
    area.addEventListener("pointermove", ({ offsetX }) => this.setCursor(this.timeAt(offsetX)));
    new ResizeObserver(() => this.draw()).observe(area);
  }

  // t: s; curves: [{side, y, colour, dash, width}], y null where there is no value, colour a token; range: of y, or none
  // for what the curves need; bands: [{from, to, colour, alpha}]; rules: [{at, colour, dash}]
  show({ t, curves, range, bands, rules }) {
    const whole = this.t.length === 0 || (this.from === this.begin && this.to === this.end);
    Object.assign(this, { t, range, bands, rules, begin: t[0] ?? 0, end: t.at(-1) ?? 1 });
    this.curves = curves.map((curve) => ({ ...curve, y: Float64Array.from(curve.y, (value) => value ?? NaN) }));
    if (whole) [this.from, this.to] = [this.begin, this.end];
    this.setWindow(this.from, this.to);
  }

  setWindow(from, to) {
    const length = Math.min(Math.max(to - from, SHORTEST_S), this.end - this.begin);
    this.from = Math.min(Math.max(from, this.begin), this.end - length);
    this.to = this.from + length;
    this.draw();
  }

  setCursor(t) {
    const row = this.t.findIndex((time) => time >= t);
    const sides = Map.groupBy(row < 0 ? [] : this.curves.filter(({ y }) => Number.isFinite(y[row])), ({ side }) => side);
    const words = [...sides].map(([side, curves]) => `${side} ${curves.map(({ y }) => y[row].toFixed(3)).join(" ")}`);
    this.values.textContent = words.length ? `${this.t[row].toFixed(3)} s: ${words.join(", ")}` : "";
  }

  timeAt(px) {
    const width = this.area.clientWidth - MARGIN.left - MARGIN.right;
    return this.from + ((px - MARGIN.left) / width) * (this.to - this.from);
  }

  draw() {
    const on = this.curves && pen(this.area.querySelector("canvas"));
    if (!on) return;
    const { context, width, height } = on;
    const pane = { top: TOP_PX, bottom: height - MARGIN.bottom, ...(this.range && { range: this.range }) };
    const curves = this.curves.map((curve) => ({ ...curve, x: this.t, pane: 0, colour: token(curve.colour), opacity: 1 }));
    const chart = new Chart({ width, height, from: this.from, to: this.to, panes: [pane], curves });
    this.drawMarks(context, chart, pane);
    chart.draw(context);
    this.area.dataset.points = this.t.length * this.curves.length;
  }

  drawMarks(context, chart, { top, bottom }) {
    context.save();
    context.beginPath();
    context.rect(MARGIN.left, top, chart.plotWidth, bottom - top);
    context.clip();
    for (const { from, to, colour, alpha } of this.bands) {
      const [left, right] = [chart.x(Math.max(from, this.from)), chart.x(Math.min(to, this.to))];
      if (right <= left) continue;
      context.globalAlpha = alpha;
      context.fillStyle = token(colour);
      context.fillRect(left, top, right - left, bottom - top);
    }
    context.globalAlpha = 1;
    context.lineWidth = 1.5;
    for (const { at, colour, dash } of this.rules) {
      context.strokeStyle = token(colour);
      context.setLineDash(dash);
      context.beginPath();
      context.moveTo(chart.x(at), top);
      context.lineTo(chart.x(at), bottom);
      context.stroke();
    }
    context.restore();
  }
}
