// The last ten seconds of the arms, on canvases: force, speed and mode, as the robot said them; a gap where it said
// nothing.

import { SIDES } from "./arms.js";
import { pen } from "./canvas.js";
import { modeColour, wordOf } from "./modes.js";

const SECONDS = 10;
const DRAW_MS = 100; // a view comes every 50 ms: drawing each of them costs more than it shows

class Strip {
  constructor(canvas) {
    this.canvas = canvas;
    this.points = [];
    this.drawnMs = 0;
  }

  add(timeMs, values) {
    this.points.push([timeMs, ...values]);
    while (this.points.length && timeMs - this.points[0][0] > SECONDS * 1000) this.points.shift();
    if (timeMs - this.drawnMs < DRAW_MS) return;
    this.drawnMs = timeMs;
    const on = pen(this.canvas);
    if (on) this.draw(on, timeMs);
  }
}

class Curves extends Strip {
  // least: the range that is always shown, so that noise does not fill the picture. lines: [token, dash] of each value.
  constructor(canvas, least, lines) {
    super(canvas);
    this.least = least;
    this.lines = lines;
  }

  draw({ context: drawing, width, height }, nowMs) {
    const style = getComputedStyle(this.canvas);
    const most = Math.max(this.least, ...this.points.flatMap(([, ...values]) => values.map((value) => value ?? 0))) * 1.1;
    drawing.strokeStyle = style.getPropertyValue("--line");
    drawing.lineWidth = 1;
    drawing.strokeRect(0.5, 0.5, width - 1, height - 1);
    this.lines.forEach(([token, dash], index) => {
      drawing.strokeStyle = style.getPropertyValue(token);
      drawing.lineWidth = dash.length ? 1 : 1.5;
      drawing.setLineDash(dash);
      drawing.beginPath();
      let going = false;
      for (const point of this.points) {
        const value = point[index + 1];
        if (value === null) {
          going = false;
          continue;
        }
        const x = width - ((nowMs - point[0]) / (SECONDS * 1000)) * width;
        const y = height - 2 - (value / most) * (height - 4);
        if (going) drawing.lineTo(x, y);
        else drawing.moveTo(x, y);
        going = true;
      }
      drawing.stroke();
    });
    drawing.setLineDash([]);
  }
}

class Modes extends Strip {
  draw({ context: drawing, width, height }, nowMs) {
    const place = (timeMs) => width - ((nowMs - timeMs) / (SECONDS * 1000)) * width;
    const row = height / SIDES.length;
    SIDES.forEach((_, side) => {
      let start = 0;
      for (let index = 1; index <= this.points.length; index += 1) {
        const mode = this.points[start][side + 1];
        if (index < this.points.length && this.points[index][side + 1] === mode) continue;
        const until = index < this.points.length ? this.points[index][0] : nowMs;
        const from = place(this.points[start][0]);
        if (mode !== null) {
          drawing.fillStyle = modeColour(mode);
          drawing.fillRect(from, side * row + 2, place(until) - from, row - 4);
        }
        start = index;
      }
    });
  }
}

const write = (id, text) => {
  const element = document.getElementById(id);
  if (element.textContent !== text) element.textContent = text;
};

export function startStrips(live) {
  const canvas = (id) => document.getElementById(id);
  const lines = (dash) => SIDES.map((side) => [`--${side}`, dash]);
  const force = new Curves(canvas("force-strip"), 10, lines([]));
  const speed = new Curves(canvas("speed-strip"), 0.1, [...lines([]), ...lines([3, 3])]);
  const mode = new Modes(canvas("mode-strip"));
  const text = (value, digits) => (value === null ? "-" : value.toFixed(digits));
  live.onView((view) => {
    const now = performance.now();
    const of = (key) => SIDES.map((side) => view[side][key]);
    const known = SIDES.map((side) => (view[side].mode === "UNKNOWN" ? null : view[side].mode));
    force.add(now, of("peak_force_n"));
    speed.add(now, [...of("pad_speed_m_s"), ...of("speed_m_s")]);
    mode.add(now, known);
    write("force-value", `${of("force_n").map((value) => text(value, 0)).join(" / ")} N`);
    write("speed-now", `${of("pad_speed_m_s").map((value) => text(value, 2)).join(" / ")} m/s`);
    const words = known.map((name) => (name === null ? "-" : wordOf(name)));
    write("mode-now", [...new Set(words)].length === 1 ? words[0] : words.join(" / "));
  });
}
