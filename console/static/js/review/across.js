// Curves against a signal instead of time: their points, the moment of the cursor, and the moment nearest to a click.

import { pen } from "../canvas.js";
import { MARGIN } from "./chart.js";
import { theme } from "./style.js";

export const MOST_POINTS = 8192; // of one request
const DOT_PX = 5;
const SAME_S = 1e-6;

// A longer window has the smallest and largest value of neighbours: what is between them.
export function middle(curve) {
  const low = curve.bucket === 1 ? curve.low : curve.low.map((value, row) => (value + curve.high[row]) / 2);
  return { ...curve, bucket: 1, low, high: low };
}

// Values at times that rise, on straight lines between rising samples; none outside of them.
function valuesAt(times, { x, y }) {
  let row = 0;
  return Float64Array.from(times, (t) => {
    while (row + 1 < x.length && x[row + 1] <= t) row += 1;
    if (x.length === 0 || t < x[0]) return NaN;
    if (row + 1 === x.length) return t === x[row] ? y[row] : NaN;
    return y[row] + ((t - x[row]) / (x[row + 1] - x[row])) * (y[row + 1] - y[row]);
  });
}

// curves over time, axes: the signal along the horizontal axis, of each log, {place, x, y}. Keeps the times as t.
export function alongSignal(curves, axes) {
  return curves.flatMap((curve) => {
    const axis = axes.find(({ place }) => place === curve.place);
    return axis ? [{ ...curve, t: curve.x, x: valuesAt(curve.x, axis) }] : [];
  });
}

// Where a sample of a curve is on the screen, px.
function spot(chart, { pane, x, y }, row) {
  const { top, bottom, range } = chart.panes[pane];
  return [chart.x(x[row]), bottom - ((y[row] - range[0]) / (range[1] - range[0])) * (bottom - top)];
}

// A dot where each curve is at the cursor, and in words what the horizontal axis is.
export function drawMoment(canvas, chart, t, lane, words) {
  const on = pen(canvas);
  if (!on) return;
  const { context } = on;
  context.font = `11px ${theme().font}`;
  context.fillStyle = theme().text;
  context.fillText(words, MARGIN.left, lane - 5);
  for (const curve of chart.curves) {
    const after = curve.t.findIndex((time) => time > t + SAME_S);
    const [px, y] = spot(chart, curve, (after < 0 ? curve.t.length : after) - 1);
    if (!Number.isFinite(px) || !Number.isFinite(y)) continue;
    context.fillStyle = curve.colour;
    context.strokeStyle = theme().text;
    context.lineWidth = 2;
    context.beginPath();
    context.arc(px, y, DOT_PX, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  }
}

// The time of this log's sample that is drawn nearest to a pointer; null where there is none.
export function nearestTime(chart, area, { clientX, clientY }) {
  const { left, top } = area.getBoundingClientRect();
  let [least, found] = [Infinity, null];
  for (const curve of chart.curves.filter(({ place }) => place === null)) {
    for (let row = 0; row < curve.x.length; row++) {
      const [px, y] = spot(chart, curve, row);
      const away = Math.hypot(px - (clientX - left), y - (clientY - top));
      if (away < least) [least, found] = [away, curve.t[row]];
    }
  }
  return found;
}
