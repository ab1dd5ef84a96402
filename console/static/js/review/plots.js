// The curves: one pane a field, one time axis for all. What is drawn the server has reduced to the window's pixels.

import { pen } from "../canvas.js";
import { showError } from "../errors.js";
import { alongSignal, drawMoment, middle, MOST_POINTS, nearestTime } from "./across.js";
import { drawBands } from "./bands.js";
import { Chart, MARGIN, points, rangeOf } from "./chart.js";
import { Legends } from "./legends.js";
import { Pointer } from "./pointer.js";
import { colourOf, dashOf, overlayLook } from "./style.js";
import { wordsOf } from "./values.js";

const LANE_PX = 18; // above the panes: impacts and verdicts in words
const GAP_PX = 6; // between a pane and what is above and below
const SMALLEST_PANE_PX = 40; // of the curves alone
const BUCKETS_PER_PX = 1; // the server rounds up to powers of two: there are 0.5 to 1, of two points each

export class Plots {
  constructor(view, signals, log) {
    this.view = view;
    this.log = log;
    this.others = []; // [{log, place, offset}]: the compared logs, the place of their look, what has to be added to their times
    this.given = new Set(); // the names of those that analyses give, which another log may lack
    this.byName = new Map(signals.map((signal) => [signal.name, signal]));
    this.area = document.getElementById("figure-area");
    this.bands = document.getElementById("bands");
    this.figure = document.getElementById("figure");
    this.cursor = document.getElementById("cursor");
    this.legends = new Legends();
    this.curves = [];
    this.drawn = null; // the window that the curves are of
    this.chart = null; // what is on the screen
    this.pending = false;
    this.request = null;
    this.since = null;
    this.fields = []; // the signals of each pane
    this.panes = []; // [{members, legend, top, bottom}] px
    this.shown = new Promise((resolve) => (this.tell = resolve)); // once the first curves are on the screen
    view.on("window", () => this.refresh());
    view.on("signals", () => this.refresh());
    view.on("cursor", () => this.showCursor());
    new ResizeObserver(() => this.refresh()).observe(document.getElementById("plots"));
    new MutationObserver(() => this.draw()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
    const timeAt = (px) => view.from + ((px - MARGIN.left) / this.width) * (view.to - view.from);
    new Pointer(view, this.area, (px, event) => (this.drawn?.across ? nearestTime(this.chart, this.area, event) ?? view.t : timeAt(px)), () => !this.drawn?.across);
  }

  // Signals that are known once the log has been read.
  know(signals) {
    for (const signal of signals) {
      this.given.add(signal.name);
      this.byName.set(signal.name, signal);
    }
  }

  get width() {
    return this.area.clientWidth - MARGIN.left - MARGIN.right;
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
        this.pending = false;
        this.refresh();
      }
    });
  }

  async load() {
    const { from, to } = this.view;
    const { across } = this.view;
    const names = [...new Set([...this.signals.map(({ name }) => name), ...(across ? [across] : [])])];
    const { others } = this;
    const width = across ? MOST_POINTS : Math.min(Math.max(Math.round(this.width * BUCKETS_PER_PX), 16), MOST_POINTS);
    const { done } = this.log.document;
    let complete = true; // there is nothing to wait for
    try {
      const [own, ...over] = await Promise.all([
        this.differs ? [] : this.log.curves(names, from, to, width),
        ...others.map((other) => this.differs ? this.log.curves(names, from, to, width, other)
          : other.log.curves(names.filter((name) => !this.given.has(name) || other.log.gives(name)), from - other.offset, to - other.offset, width)),
      ]);
      const moved = (other) => (this.differs ? 0 : other.offset);
      this.curves = [
        ...own.map((curve) => ({ ...curve, offset: 0, place: null })),
        ...over.flatMap((curves, place) => curves.map((curve) => ({ ...curve, offset: moved(others[place]), place: others[place].place }))),
      ];
      if (across) this.curves = this.curves.map(middle);
      this.drawn = { from, to, across };
      this.draw();
      complete = done || names.length === 0 || this.curves.some(({ t }) => t.length > 0);
      performance.measure("curves", { start: this.since, end: performance.now() });
      if (!this.pending) this.since = null;
    } catch (error) {
      this.since = null;
      showError(`The curves are not up to date: ${error.message}`);
    } finally {
      if (complete) this.tell();
    }
  }

  draw() {
    if (this.drawn === null) return;
    const { signals } = this;
    const followed = new Map(signals.filter(({ reference }) => reference).map(({ reference, field }) => [reference, field]));
    this.fields = [...Map.groupBy(signals, ({ name, field }) => (this.view.reference && followed.get(name)) || field).values()];
    document.getElementById("no-signal").hidden = signals.length > 0;
    this.area.hidden = signals.length === 0;
    const legends = this.legends.show(this.fields, (signal) => this.colour(signal), this.area.clientWidth, this.differs);
    const around = legends.reduce((sum, height) => sum + height + GAP_PX, MARGIN.bottom + LANE_PX); // what is no curve
    const printing = document.documentElement.matches(".printing");
    const smallest = printing ? 0 : SMALLEST_PANE_PX;
    this.area.style.height = `${Math.max(this.area.parentElement.clientHeight, around + this.fields.length * smallest)}px`;
    const on = pen(this.figure);
    if (on === null) return;
    const pane = (on.height - around) / this.fields.length;
    let below = LANE_PX;
    this.panes = this.fields.map((members, row) => {
      const [legend, top] = [below + 1, below + legends[row] + GAP_PX / 3];
      below = top + pane + (2 * GAP_PX) / 3;
      return { members, legend: Math.round(legend), top: Math.round(top), bottom: Math.round(top + pane) };
    });
    this.legends.move(this.panes.map(({ legend }) => legend));
    const { from, to, across } = this.drawn;
    let curves = this.curves.flatMap((curve) => this.styled(curve));
    const axis = across ? this.byName.get(across) : null;
    if (axis) curves = alongSignal(curves, this.curves.filter(({ name }) => name === across).map((curve) => ({ ...curve, ...points(curve) })));
    const [left, right] = axis ? rangeOf(curves, "x") : [from, to];
    this.chart = new Chart({ width: on.width, height: on.height, from: left, to: right, panes: this.panes, curves, ...(axis && { unit: axis.unit, ordered: false }) });
    this.drawBehind(printing ? this.figure : this.bands); // on paper a canvas hides the one behind it
    this.chart.draw(on.context);
    this.showCursor();
    this.area.dataset.points = this.chart.curves.reduce((sum, { x }) => sum + x.length, 0);
    this.area.dataset.window = `${this.drawn.from},${this.drawn.to}`;
  }

  // A curve as the chart takes it; none whose signal has been unticked meanwhile.
  styled(curve) {
    const pane = this.panes.findIndex(({ members }) => members.some(({ name }) => name === curve.name));
    if (pane < 0) return [];
    const signal = this.byName.get(curve.name);
    const dash = dashOf(signal);
    const look = curve.place === null ? { dash, width: 1.5, opacity: 1, colour: this.colour(signal) } : overlayLook(curve.place, signal.whose === "right", dash !== "solid");
    return [{ name: curve.name, place: curve.place, pane, ...points(curve), ...look }];
  }

  // The signals that are drawn: what is ticked, and with it what it is to follow.
  get signals() {
    const ticked = this.view.signals.map((name) => this.byName.get(name)).filter(Boolean);
    if (!this.view.reference) return ticked;
    return [...new Set([...ticked, ...ticked.map(({ reference }) => this.byName.get(reference)).filter(Boolean)])];
  }

  // Whether differences are drawn instead of the logs.
  get differs() {
    return this.view.difference && this.others.length > 0 && !this.view.across;
  }

  colour(signal) {
    const members = this.fields.find((field) => field.includes(signal)) ?? [signal];
    const family = members.filter(({ group, field }) => group === signal.group && field === signal.field);
    return colourOf(signal, family.indexOf(signal));
  }

  drawBehind(canvas = this.bands) {
    const axis = this.byName.get(this.drawn.across);
    if (axis) return drawMoment(canvas, this.chart, this.view.t, LANE_PX, `across: ${wordsOf(axis)}`);
    const area = { left: MARGIN.left, right: MARGIN.left + this.chart.plotWidth, lane: LANE_PX };
    drawBands(canvas, this.log, (t) => this.chart.x(t), area, this.panes);
  }

  showCursor() {
    if (this.chart === null) return;
    if (this.drawn.across) {
      this.cursor.hidden = true;
      return this.drawBehind();
    }
    const px = this.chart.x(this.view.t);
    this.cursor.hidden = px < MARGIN.left - 1 || px > MARGIN.left + this.chart.plotWidth + 1;
    this.cursor.style.transform = `translateX(${px}px)`;
  }
}
