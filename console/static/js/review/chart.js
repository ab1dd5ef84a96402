// Axes and curves of all panes on one canvas: drawn in one go, with nothing that the browser would have to lay out.

import { DASHES, theme } from "./style.js";

export const MARGIN = { left: 64, right: 12, bottom: 28 };
const TICK_PX = { x: 90, y: 28 }; // between two of them at least
const MOST_TICKS_Y = 5;
const CROWDED = 6; // px up and down a pixel of width: from then on a curve is an area
const ROOM = 0.05; // of a pane's range above and below its curves

export class Chart {
  // panes: [{top, bottom}] px, a range too where it is not what the curves need; curves: [{name, pane, x, y, colour, dash, width, opacity}],
  // x in `unit`, pane: its place there; ordered: whether x rises along every curve
  constructor({ width, height, from, to, panes, curves, unit = "s", ordered = true }) {
    Object.assign(this, { width, height, from, to, curves, unit, ordered });
    this.plotWidth = width - MARGIN.left - MARGIN.right;
    this.panes = panes.map((pane, place) => ({ range: rangeOf(curves.filter((curve) => curve.pane === place)), ...pane }));
  }

  x(t) {
    return MARGIN.left + ((t - this.from) / (this.to - this.from)) * this.plotWidth;
  }

  draw(context) {
    const { text, line, font } = theme();
    const times = ticks([this.from, this.to], Math.max(2, this.plotWidth / TICK_PX.x));
    context.save();
    context.font = `12px ${font}`;
    context.lineWidth = 1;
    this.panes.forEach((pane) => this.drawGrid(context, pane, times, { text, line }));
    context.fillStyle = text;
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const { value, label } of times) {
      const half = context.measureText(`${label} ${this.unit}`).width / 2;
      context.fillText(`${label} ${this.unit}`, Math.min(this.x(value), this.width - half), this.height - MARGIN.bottom + 6);
    }
    this.panes.forEach((pane, place) => {
      context.save();
      context.beginPath();
      context.rect(MARGIN.left, pane.top, this.plotWidth, pane.bottom - pane.top);
      context.clip();
      for (const curve of this.curves) if (curve.pane === place) this.drawCurve(context, pane, curve);
      context.restore();
    });
    context.restore();
  }

  drawGrid(context, { top, bottom, range }, times, { text, line }) {
    const crisp = (px) => Math.round(px) + 0.5;
    const marks = ticks(range, Math.min(MOST_TICKS_Y, Math.max(2, (bottom - top) / TICK_PX.y)));
    const y = (value) => bottom - ((value - range[0]) / (range[1] - range[0])) * (bottom - top);
    context.strokeStyle = line;
    context.fillStyle = text;
    context.textAlign = "right";
    context.textBaseline = "middle";
    context.beginPath();
    for (const { value, label } of marks) {
      context.moveTo(MARGIN.left, crisp(y(value)));
      context.lineTo(MARGIN.left + this.plotWidth, crisp(y(value)));
      context.fillText(label, MARGIN.left - 6, y(value));
    }
    for (const { value } of times) {
      context.moveTo(crisp(this.x(value)), top);
      context.lineTo(crisp(this.x(value)), bottom);
    }
    context.stroke();
  }

  drawCurve(context, { top, bottom, range }, { x, y, colour, dash, width, opacity }) {
    const [perSecond, perUnit] = [this.plotWidth / (this.to - this.from), (bottom - top) / (range[1] - range[0])];
    const px = (row) => MARGIN.left + (x[row] - this.from) * perSecond;
    const py = (row) => bottom - (y[row] - range[0]) * perUnit;
    context.globalAlpha = opacity;
    if (this.ordered && travel(y) * perUnit > CROWDED * this.plotWidth) {
      context.fillStyle = colour;
      drawColumns(context, x.length, px, py, width / 2);
      return;
    }
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.lineJoin = "bevel"; // a mitre would lengthen a spike
    context.setLineDash(DASHES[dash]);
    context.beginPath();
    let going = false; // a gap where there is no number
    for (let row = 0; row < x.length; row++) {
      if (!Number.isFinite(y[row])) going = false;
      else if (going) context.lineTo(px(row), py(row));
      else context.moveTo(px(row), py(row));
      going = Number.isFinite(y[row]);
    }
    context.stroke();
  }
}

// How far a curve goes up and down, together.
function travel(y) {
  let sum = 0;
  for (let row = 1; row < y.length; row++) sum += Math.abs(y[row] - y[row - 1]) || 0;
  return sum;
}

// A curve that fills its pane: for each column of pixels the rectangle that a line to and fro would cover, which costs
// a tenth of such a line. px, py: of a row.
function drawColumns(context, rows, px, py, half) {
  let [column, high, low, last] = [null, 0, 0, null];
  const finish = (next) => column === null || context.fillRect(column, high - half, next - column, low - high + 2 * half);
  for (let row = 0; row < rows; row++) {
    const [at, height] = [Math.round(px(row)), py(row)];
    if (Number.isFinite(height)) {
      if (at !== column) {
        finish(at);
        [column, high, low] = [at, last ?? height, last ?? height];
      }
      [high, low, last] = [Math.min(high, height), Math.max(low, height), height];
    } else {
      finish(column + 1);
      [column, last] = [null, null];
    }
  }
  finish(column + 1);
}

// Of what the curves have, y or x, with some room around it.
export function rangeOf(curves, what = "y") {
  let [low, high] = [Infinity, -Infinity];
  for (const { [what]: values } of curves) {
    for (const value of values) {
      if (value < low && value > -Infinity) low = value;
      if (value > high && value < Infinity) high = value;
    }
  }
  if (low > high) return [-1, 1];
  if (low === high) return [low - 1, high + 1];
  return [low - ROOM * (high - low), high + ROOM * (high - low)];
}

// Round values in a range, 1, 2 or 5 times a power of ten apart, some `most` steps and two values at least:
// [{value, label}].
function ticks([low, high], most) {
  const rough = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * (1 - 1e-9));
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const label = (value) => (decimals > 6 || Math.abs(value) >= 1e6 ? value.toExponential(2) : value.toFixed(decimals));
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  if (count < 2) return ticks([low, high], 2 * most); // one alone says nothing about the scale
  return Array.from({ length: count }, (_, place) => (first + place) * step).map((value) => ({ value, label: label(value) }));
}

// A bucket is drawn as a line between its smallest and its largest value, the nearer one first: a spike of one sample
// stays, and a slope stays smooth.
export function points({ bucket, t, low, high, offset }) {
  if (bucket === 1) return { x: offset ? t.map((value) => value + offset) : t, y: low };
  const [x, y] = [new Float64Array(2 * t.length), new Float32Array(2 * t.length)];
  let last = low[0];
  for (let row = 0; row < t.length; row++) {
    const next = row + 1 < t.length ? t[row + 1] : t[row];
    const rising = Math.abs(low[row] - last) <= Math.abs(high[row] - last);
    x[2 * row] = t[row] + offset;
    x[2 * row + 1] = (t[row] + next) / 2 + offset;
    y[2 * row] = rising ? low[row] : high[row];
    y[2 * row + 1] = last = rising ? high[row] : low[row];
  }
  return { x, y };
}
