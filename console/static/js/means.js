// The means of the queue's trials as they end: a table by controller and object, and a plot over the shift.

import { get } from "./api.js";
import { pen } from "./canvas.js";
import { showError } from "./errors.js";
import { plain } from "./formats.js";
import { cell } from "./log_table.js";
import { token } from "./theme.js";
import { rounded } from "./trial_card.js";

const COLOURS = ["left", "right", "good", "teleoperation", "stopping", "amber", "faint"];
const $ = (id) => document.getElementById(id);
const share = (value) => `${(100 * value).toFixed(0)} %`;

function interval({ mean, low, high, n }, text) {
  if (mean === null) return "-";
  return low === null ? `${text(mean)} (n = ${n})` : `${text(mean)} [${text(low)}, ${text(high)}]`;
}

// The step of an axis that ends at `most`: 1, 2 or 5 times a power of ten, four or five of them.
function stepOf(most) {
  const power = 10 ** Math.floor(Math.log10(most / 4));
  return power * [1, 2, 5, 10].find((times) => times * power * 5 >= most);
}

export class Means {
  constructor() {
    this.measure = $("measure");
    this.body = $("means-table").tBodies[0];
    this.lines = [];
    this.ended = "";
    this.measure.addEventListener("change", () => this.refresh());
    new ResizeObserver(() => this.draw()).observe($("means-plot"));
  }

  // Asks again once other trials have ended than before.
  follow(entries) {
    const ended = entries.filter((entry) => entry.log !== null).map((entry) => entry.log).join();
    if (ended === this.ended) return;
    this.ended = ended;
    this.refresh();
  }

  async refresh() {
    try {
      this.lines = await get(`/api/trials/means?measure=${this.measure.value}`);
      this.show();
    } catch (error) {
      showError(`The means are not up to date: ${error.message}`);
    }
  }

  show() {
    const text = this.measure.value === "success" ? share : rounded;
    $("means-empty").hidden = this.lines.length > 0;
    $("means-shown").hidden = this.lines.length === 0;
    this.body.replaceChildren();
    this.lines.forEach((line, index) => {
      const row = this.body.insertRow();
      const name = cell(row, "");
      const mark = document.createElement("i");
      mark.className = "mark";
      mark.style.setProperty("--mark", token(COLOURS[index % COLOURS.length]));
      name.append(mark, `${plain(line.controller)}, ${plain(line.object)}`);
      const aborted = line.aborted ? `, ${line.aborted} aborted` : "";
      const successes = cell(row, `${line.successes} of ${line.trials}${aborted}`, "number");
      if (line.unexpected) successes.dataset.ending = "unexpected impact";
      successes.title = [line.unexpected && `${line.unexpected} of them with an unexpected impact`, aborted && "aborted by STOP, an operator, a watchdog or a robot: they count against no controller"].filter(Boolean).join("; ");
      cell(row, interval(line.whole, text), "number").title = line.whole.low === null ? "An interval needs two trials at each shift at least" : `${line.whole.n} trials`;
    });
    this.draw();
  }

  draw() {
    const on = pen($("means-plot"));
    if (!on) return;
    const { context, width, height } = on;
    const points = this.lines.flatMap((line) => line.points).filter(({ mean }) => mean !== null);
    if (!points.length) return;
    const tick = this.measure.value === "success" ? share : (value) => String(Number(value.toPrecision(3)));
    const shifts = [...new Set(points.map((point) => point.displacement_mm))].sort((a, b) => a - b);
    const [from, to] = [shifts[0], shifts[shifts.length - 1]];
    const most = Math.max(...points.map(({ mean, high }) => high ?? mean)) * 1.08 || 1;
    const area = { left: 56, right: width - 16, top: 10, bottom: height - 32 };
    const x = (shift) => (to > from ? area.left + 12 + ((shift - from) / (to - from)) * (area.right - area.left - 24) : (area.left + area.right) / 2);
    const y = (value) => area.bottom - (Math.max(value, 0) / most) * (area.bottom - area.top);
    context.font = `11px ${token("font")}`;
    context.fillStyle = token("faint");
    context.strokeStyle = token("line");
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (let value = 0; value <= most; value += stepOf(most)) {
      context.fillText(tick(value), area.left - 6, y(value));
      context.strokeRect(area.left, y(value), area.right - area.left, 0);
    }
    context.textAlign = "center";
    context.textBaseline = "alphabetic";
    let free = -Infinity;
    for (const shift of shifts) {
      if (x(shift) < free) continue;
      context.fillText(String(shift), x(shift), area.bottom + 14);
      free = x(shift) + 34;
    }
    context.fillText("shift of the object along y, mm", (area.left + area.right) / 2, height - 4);
    this.lines.forEach((line, index) => this.drawLine(context, line, index, x, y));
  }

  drawLine(context, line, index, x, y) {
    const known = line.points.filter(({ mean }) => mean !== null);
    const aside = (index - (this.lines.length - 1) / 2) * 3; // intervals of several at one shift stay apart
    context.strokeStyle = context.fillStyle = token(COLOURS[index % COLOURS.length]);
    context.lineWidth = 1.5;
    context.setLineDash(index >= COLOURS.length ? [4, 3] : []);
    context.beginPath();
    for (const { displacement_mm, mean } of known) context.lineTo(x(displacement_mm) + aside, y(mean));
    context.stroke();
    context.setLineDash([]);
    for (const { displacement_mm, mean, low, high } of known) {
      const place = x(displacement_mm) + aside;
      context.beginPath();
      context.arc(place, y(mean), 3.5, 0, 2 * Math.PI);
      context.fill();
      if (low === null) continue;
      context.beginPath();
      for (const end of [low, high]) {
        context.moveTo(place - 4, y(end));
        context.lineTo(place + 4, y(end));
      }
      context.moveTo(place, y(low));
      context.lineTo(place, y(high));
      context.stroke();
    }
  }
}
