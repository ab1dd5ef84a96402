// What a trial ends in: the verdict in a word, three numbers beside the last ten trials, its impact, and what comes next.

import { get, post } from "./api.js";
import { whyNoRun } from "./control.js";
import { showError } from "./errors.js";
import { pen } from "./canvas.js";
import { drawModes } from "./review/bands.js";
import { token } from "./theme.js";

const STEP_MM = 10;
const BANDS_ALPHA = 0.22;
const $ = (id) => document.getElementById(id);

// So many digits as mean something.
export const rounded = (value) => (value === null ? "-" : value.toFixed(Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2));

function make(kind, className, text = "") {
  const element = document.createElement(kind);
  element.className = className;
  element.textContent = text;
  return element;
}

// Earlier trials as dots, their mean and spread as a bar, this one as a line.
function drawStrip(canvas, number) {
  const on = pen(canvas);
  if (!on) return;
  const { context, width, height } = on;
  const all = [...number.before, ...(number.value === null ? [] : [number.value])];
  if (!all.length) return;
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const x = (value) => (high > low ? 4 + ((value - low) / (high - low)) * (width - 8) : width / 2);
  if (number.spread !== null) {
    context.globalAlpha = 0.3;
    context.fillStyle = token("faint");
    const [from, to] = [number.mean - number.spread, number.mean + number.spread].map((value) => Math.min(Math.max(x(value), 0), width));
    context.fillRect(from, height / 2 - 3, Math.max(to - from, 1), 6);
  }
  context.globalAlpha = 0.8;
  context.fillStyle = token("faint");
  for (const value of number.before) {
    context.beginPath();
    context.arc(x(value), height / 2, 2, 0, 2 * Math.PI);
    context.fill();
  }
  context.globalAlpha = 1;
  if (number.value === null) return;
  context.fillStyle = token("accent");
  context.fillRect(x(number.value) - 1.5, 0, 3, height);
}

function drawImpact(canvas, impact) {
  const on = pen(canvas);
  if (!on || !impact) return;
  const { context, width, height } = on;
  const [from, to] = [impact.t_ms[0], impact.t_ms[impact.t_ms.length - 1]];
  const most = Math.max(10, ...impact.left, ...impact.right) * 1.08;
  const bottom = height - 12;
  const x = (t) => ((t - from) / Math.max(to - from, 1)) * width;
  const y = (force) => bottom - (force / most) * (bottom - 2);
  drawModes(context, impact.modes, x, 0, width, 0, bottom, BANDS_ALPHA, false);
  context.font = `10px ${token("font")}`;
  context.fillStyle = token("faint");
  context.textBaseline = "alphabetic";
  for (const [t, align] of [[from, "left"], [0, "center"], [to, "right"]]) {
    context.textAlign = align;
    context.fillText(t.toFixed(0), x(t), height - 2);
  }
  context.textAlign = "left";
  context.fillText(`${most.toFixed(0)} N`, 2, 10);
  context.fillRect(x(0) - 0.5, 0, 1, bottom);
  context.lineWidth = 1.5;
  for (const side of ["left", "right"]) {
    context.strokeStyle = token(side);
    context.beginPath();
    impact[side].forEach((force, index) => context.lineTo(x(impact.t_ms[index]), y(force)));
    context.stroke();
  }
}

export class TrialCard {
  constructor(live) {
    this.card = null;
    this.log = null;
    this.view = null;
    $("card-again").addEventListener("click", () => this.again(0));
    $("card-again-shifted").addEventListener("click", () => this.again(STEP_MM));
    $("card-away").addEventListener("click", () => this.place(false));
    new ResizeObserver(() => this.draw()).observe($("card-plot"));
    live.onView((view) => {
      this.view = view;
      this.allow();
    });
  }

  hide() {
    if (this.log === null && this.card === null) return;
    this.log = this.card = null;
    this.place(false);
  }

  // Another trial runs: its line stands in the card's place, where there is a card.
  wait() {
    if (this.card === null || $("trial-card").hidden) return this.hide();
    this.log = null;
    $("job").classList.add("waiting");
    $("job-line").hidden = false;
  }

  place(shown) {
    $("job").classList.remove("waiting");
    $("trial-card").hidden = !shown;
    $("job-line").hidden = shown;
  }

  // log: the name of its file, as the job has it.
  async show(log) {
    if (this.log === log) return;
    this.log = log;
    try {
      const rows = await get(`/api/logs?${new URLSearchParams({ kind: "trial", q: log })}`);
      const row = rows.find((one) => one.name === log);
      if (!row || this.log !== log) return;
      const card = await get(`/api/trials/${row.id}/card`);
      if (this.log === log) this.fill(card);
    } catch (error) {
      this.place(false);
      showError(`What the trial came to is not shown: ${error.message}`);
    }
  }

  fill(card) {
    this.card = card;
    $("card-ending").textContent = card.ending;
    $("card-ending").dataset.ending = card.ending;
    $("card-what").textContent = card.what;
    $("card-sentence").textContent = card.sentence;
    $("card-sentence").title = card.sentence;
    document.querySelector("#trial-card .numbers").replaceChildren(...card.numbers.map((number) => this.line(number)));
    $("card-open").href = `/logs/${card.row.id}${card.impact ? `?t=${card.impact.at_s.toFixed(3)}` : ""}`;
    const compare = $("card-compare");
    if (card.before) compare.href = `/logs/${card.row.id}?other=${card.before}${card.impact ? `&t=${card.impact.at_s.toFixed(3)}` : ""}`;
    else compare.removeAttribute("href");
    compare.setAttribute("aria-disabled", String(!card.before));
    compare.title = card.before ? "Both in one view, aligned at the impact" : "There is no trial before it";
    this.place(true);
    this.allow();
    this.draw();
  }

  line(number) {
    const line = document.createElement("li");
    line.title = number.about;
    const value = make("span", "value", rounded(number.value));
    const spread = number.spread === null ? "" : `\u00a0\u00b1\u00a0${rounded(number.spread)}`;
    const before = make("span", "before", number.mean === null ? "none before" : `before ${rounded(number.mean)}${spread}`);
    before.title = `Mean and standard deviation of the last ${number.before.length} trials with this object`;
    line.append(make("span", "name", number.name), value, make("span", "unit", ` ${number.unit}`), document.createElement("canvas"), before);
    return line;
  }

  draw() {
    if (!this.card) return;
    const strips = document.querySelectorAll("#trial-card .numbers canvas");
    this.card.numbers.forEach((number, index) => drawStrip(strips[index], number));
    drawImpact($("card-plot"), this.card.impact);
  }

  allow() {
    if (!this.card) return;
    const why = this.view === null ? "the console has not heard from the robot yet" : whyNoRun(this.view) ?? this.card.refusal;
    for (const [id, what] of [["card-again", "The same trial once more, with the same seed"], ["card-again-shifted", "The same trial, the object shifted by 10 mm more towards the left arm"]]) {
      $(id).disabled = why !== null;
      $(id).title = why ?? what;
    }
  }

  async again(further_mm) {
    const order = { ...this.card.again, displacement_mm: this.card.again.displacement_mm + further_mm };
    for (const id of ["card-again", "card-again-shifted"]) $(id).disabled = true;
    try {
      await post("/api/jobs/trial", order);
    } catch (error) {
      showError(`Trial not started: ${error.message}. The robot stays as it is.`);
    }
  }
}
