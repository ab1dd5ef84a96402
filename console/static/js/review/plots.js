/* global Plotly */
// The curves: one pane a field, one time axis for all. plotly draws what the server has reduced to the window's pixels.

import { showError } from "../errors.js";
import { drawBands } from "./bands.js";
import { colourOf, dashOf, theme } from "./style.js";

const MARGIN = { left: 64, right: 12, bottom: 28 };
const LEGEND_PX = 22;
const SMALLEST_PANE_PX = 96;
const CLICK_PX = 4;
const BUCKETS_PER_PX = 1.5; // the server rounds up to powers of two: there are 0.75 to 1.5
const CONFIG = { displayModeBar: false, doubleClick: false, scrollZoom: true, responsive: false };

export class Plots {
  constructor(view, signals, log) {
    this.view = view;
    this.log = log;
    this.other = null; // {log, offset}: the compared log, and what has to be added to its time
    this.byName = new Map(signals.map((signal) => [signal.name, signal]));
    this.area = document.getElementById("figure-area");
    this.figure = document.getElementById("figure");
    this.cursor = document.getElementById("cursor");
    this.curves = [];
    this.values = {};
    this.pending = null;
    this.request = null;
    this.since = null;
    this.panes = [];
    view.on("window", () => this.refresh());
    view.on("signals", () => this.refresh());
    view.on("cursor", () => this.showCursor());
    new ResizeObserver(() => this.refresh()).observe(document.getElementById("plots"));
    new MutationObserver(() => this.draw()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
    this.listen();
  }

  get width() {
    return this.area.clientWidth - MARGIN.left - MARGIN.right;
  }

  x(t) {
    return MARGIN.left + ((t - this.view.from) / (this.view.to - this.view.from)) * this.width;
  }

  time(px) {
    return this.view.from + ((px - MARGIN.left) / this.width) * (this.view.to - this.view.from);
  }

  // Ask for what is shown, at most once at a time; what changes meanwhile is asked for next.
  refresh() {
    if (this.view.to === null || this.log.document === null) return;
    this.since ??= performance.now();
    if (this.request !== null) {
      this.pending = true;
      return;
    }
    this.request = this.load().finally(() => {
      this.request = null;
      if (this.pending) {
        this.pending = null;
        this.refresh();
      }
    });
  }

  async load() {
    const { from, to, signals } = this.view;
    const names = signals.filter((name) => this.byName.has(name));
    const width = Math.min(Math.max(Math.round(this.width * BUCKETS_PER_PX), 16), 8192);
    try {
      const parts = [this.log.curves(names, from, to, width)];
      if (this.other) parts.push(this.other.log.curves(names, from - this.other.offset, to - this.other.offset, width));
      const [own, others = []] = await Promise.all(parts);
      this.curves = [...own.map((curve) => ({ ...curve, offset: 0 })), ...others.map((curve) => ({ ...curve, offset: this.other?.offset ?? 0, other: true }))];
      this.drawn = { from, to };
      await this.draw();
      performance.measure("curves", { start: this.since, end: performance.now() });
      if (!this.pending) this.since = null;
    } catch (error) {
      this.since = null;
      showError(`The curves are not up to date: ${error.message}`);
    }
  }

  async draw() {
    const shown = this.drawn;
    if (!shown) return;
    const signals = this.view.signals.map((name) => this.byName.get(name)).filter(Boolean);
    const fields = [...Map.groupBy(signals, (signal) => signal.field).values()];
    document.getElementById("no-signal").hidden = signals.length > 0;
    this.area.hidden = signals.length === 0;
    const wanted = Math.max(this.area.parentElement.clientHeight, fields.length * SMALLEST_PANE_PX + MARGIN.bottom);
    this.area.style.height = `${wanted}px`;
    const height = this.area.clientHeight;
    const pane = (height - MARGIN.bottom) / Math.max(fields.length, 1);
    this.panes = fields.map((members, row) => ({ members, top: row * pane + LEGEND_PX, bottom: (row + 1) * pane - 4 }));
    const { traces, layout } = this.picture(shown, height);
    await Plotly.react(this.figure, traces, layout, CONFIG);
    this.listenToPlotly();
    this.drawBehind();
    this.showLegends();
    this.showCursor();
    this.area.dataset.window = `${shown.from},${shown.to}`;
  }

  picture({ from, to }, height) {
    const { text, line, font } = theme();
    const inner = height - MARGIN.bottom;
    const layout = {
      width: this.area.clientWidth, height, showlegend: false, hovermode: false, dragmode: "zoom",
      margin: { l: MARGIN.left, r: MARGIN.right, t: 0, b: MARGIN.bottom },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { family: font, size: 12, color: text },
      xaxis: { range: [from, to], anchor: this.panes.length > 1 ? `y${this.panes.length}` : "y", ticksuffix: " s", gridcolor: line, zeroline: false, linecolor: line },
    };
    this.panes.forEach(({ top, bottom }, row) => {
      layout[row === 0 ? "yaxis" : `yaxis${row + 1}`] = {
        domain: [Math.max(0, 1 - bottom / inner), Math.min(1, 1 - top / inner)], fixedrange: true, gridcolor: line, zerolinecolor: line, linecolor: line, nticks: 5, automargin: false,
      };
    });
    const traces = this.curves.flatMap((curve) => {
      const row = this.panes.findIndex(({ members }) => members.some(({ name }) => name === curve.name));
      if (row < 0) return [];
      const signal = this.byName.get(curve.name);
      const { x, y } = points(curve);
      return [{
        type: "scatter", mode: "lines", x, y, xaxis: "x", yaxis: row === 0 ? "y" : `y${row + 1}`, name: curve.name,
        line: { color: this.colour(signal), width: curve.other ? 1 : 1.5, dash: curve.other ? "longdashdot" : dashOf(signal), simplify: false },
        opacity: curve.other ? 0.75 : 1, hoverinfo: "skip",
      }];
    });
    return { traces, layout };
  }

  colour(signal) {
    const pane = this.panes.find(({ members }) => members.includes(signal));
    const family = (pane?.members ?? [signal]).filter(({ group }) => group === signal.group);
    return colourOf(signal, family.indexOf(signal));
  }

  drawBehind() {
    const area = { left: MARGIN.left, right: MARGIN.left + this.width, top: 0, bottom: this.area.clientHeight - MARGIN.bottom };
    drawBands(document.getElementById("bands"), this.log.document, (t) => this.x(t), area, this.panes);
  }

  showLegends() {
    const place = document.getElementById("legends");
    this.written = new Map();
    place.replaceChildren(...this.panes.map(({ members, top }) => {
      const legend = document.createElement("div");
      legend.className = "legend";
      legend.style.top = `${top - LEGEND_PX + 1}px`;
      const title = document.createElement("b");
      title.textContent = members[0].unit ? `${members[0].field}, ${members[0].unit}` : members[0].field;
      legend.append(title, ...members.map((signal) => this.entry(signal)));
      return legend;
    }));
    this.showValues(this.values);
  }

  entry(signal) {
    const entry = document.createElement("span");
    entry.className = "entry";
    entry.innerHTML = '<svg viewBox="0 0 20 8" aria-hidden="true"><line x1="0" x2="20" y1="4" y2="4" stroke-width="2.5"/></svg>';
    const line = entry.querySelector("line");
    line.setAttribute("stroke", this.colour(signal));
    line.setAttribute("stroke-dasharray", { dash: "6 3", dot: "2 2", solid: "none" }[dashOf(signal)]);
    const value = document.createElement("span");
    value.className = "value";
    this.written.set(signal.name, value);
    entry.append(signal.component ? `${signal.group} ${signal.component}` : signal.group, value);
    return entry;
  }

  // What the curves are at the cursor, as the server has it: exact, not what a pixel can tell.
  showValues(values) {
    this.values = values;
    for (const [name, element] of this.written ?? []) {
      const value = values[name];
      element.textContent = value === undefined ? "" : value === null ? "none" : digits(value);
    }
  }

  showCursor() {
    if (this.view.to === null) return;
    const px = this.x(this.view.t);
    this.cursor.hidden = px < MARGIN.left - 1 || px > MARGIN.left + this.width + 1;
    this.cursor.style.transform = `translateX(${px}px)`;
  }

  listenToPlotly() {
    if (this.listening) return;
    this.listening = true;
    this.figure.on("plotly_relayout", (change) => {
      if ("xaxis.range[0]" in change) this.view.setWindow(Number(change["xaxis.range[0]"]), Number(change["xaxis.range[1]"]));
    });
    this.figure.on("plotly_doubleclick", () => this.view.setWindow(0, this.view.end));
  }

  // A click sets the cursor, a drag on it moves it; a drag elsewhere is plotly's, and zooms.
  listen() {
    let down = null;
    this.area.addEventListener("pointerdown", (event) => (down = event), { capture: true });
    window.addEventListener("pointerup", (event) => {
      const clicked = down !== null && Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) < CLICK_PX;
      if (clicked && event.button === 0 && event.target !== this.cursor) this.view.setCursor(this.time(this.place(event)));
      down = null;
    }, { capture: true });
    this.cursor.addEventListener("pointerdown", (event) => this.cursor.setPointerCapture(event.pointerId));
    this.cursor.addEventListener("pointermove", (event) => {
      if (this.cursor.hasPointerCapture(event.pointerId)) this.view.setCursor(this.time(this.place(event)));
    });
  }

  place(event) {
    return event.clientX - this.area.getBoundingClientRect().left;
  }
}

// A bucket is drawn as a line between its smallest and its largest value, the nearer one first: a spike of one sample
// stays, and a slope stays smooth.
function points({ bucket, t, low, high, offset }) {
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

export function digits(value) {
  const size = Math.abs(value);
  return value.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : size >= 1 ? 3 : 4);
}
