// A recording: what is extracted from it, the impact's time by hand, and what a person says about it.

import { get, post } from "./api.js";
import { showError } from "./errors.js";
import { startFrame } from "./frame.js";
import { startPlayback } from "./playback.js";

const $ = (id) => document.getElementById(id);
const id = document.querySelector("main").dataset.id;
const SIDES = ["left", "right"];

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function band(from, to, fill) {
  return { type: "rect", xref: "x", yref: "paper", x0: from, x1: to, y0: 0, y1: 1, fillcolor: fill, opacity: 0.18, line: { width: 0 } };
}

function rule(at, stroke, dash) {
  return { type: "line", xref: "x", yref: "paper", x0: at, x1: at, y0: 0, y1: 1, line: { color: stroke, width: 1.5, dash } };
}

function layout(title, shapes, range) {
  const grid = { gridcolor: colour("--line"), zerolinecolor: colour("--line") };
  return {
    title: { text: title, font: { size: 13 }, x: 0, xanchor: "left" },
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: colour("--text"), size: 12 },
    margin: { l: 56, r: 12, t: 28, b: 36 },
    showlegend: false,
    shapes,
    xaxis: { ...grid, title: { text: "time, s" }, ...(range ? { range } : {}) },
    yaxis: { ...grid },
  };
}

const line = (x, y, name, side, dash, width = 1.5) => ({
  x, y, name: `${name}, ${side}`, mode: "lines", line: { color: colour(`--${side}`), dash, width },
});

class Page {
  constructor() {
    this.tried = null; // an impact's time that is looked at and not kept
    this.acceptance = null;
    this.drawn = "";
    $("impact").addEventListener("change", () => this.look($("impact").value === "" ? null : $("impact").valueAsNumber));
    $("detected").addEventListener("click", () => {
      $("impact").value = "";
      this.look(null);
    });
    $("accept").addEventListener("click", () => this.say("accepted"));
    $("reject").addEventListener("click", () => this.say("rejected"));
    $("keep").addEventListener("click", () => this.say(this.acceptance.verdict));
    $("discard").addEventListener("click", () => this.discard());
    $("theme").addEventListener("click", () => this.data && this.draw());
  }

  async load() {
    try {
      this.show(await get(`/api/recordings/${id}`), true);
    } catch (error) {
      $("verdict").textContent = error.message;
      showError(`This recording cannot be shown: ${error.message}`);
    }
  }

  async look(seconds) {
    this.tried = seconds;
    const query = seconds === null ? "" : `?nominal_impact_s=${seconds}`;
    if (seconds === null && this.acceptance.nominal_impact_s !== null) {
      await this.say(this.acceptance.verdict); // without one by hand
      return this.load();
    }
    try {
      this.show(await get(`/api/recordings/${id}${query}`), false);
    } catch (error) {
      showError(`Not extracted again: ${error.message}`);
    }
  }

  show(data, first) {
    this.data = data;
    this.acceptance = data.acceptance;
    const { extraction, acceptance } = data;
    if (first) {
      $("name").value = acceptance.name;
      $("note").value = acceptance.note;
      $("impact").value = acceptance.nominal_impact_s ?? "";
      this.tried = acceptance.nominal_impact_s;
    }
    $("impact").max = extraction.duration_s;
    $("impact").placeholder = extraction.detected_impact_s === null ? "none found" : extraction.detected_impact_s.toFixed(3);
    const seconds = (value) => (value === null ? "none" : `${value.toFixed(3)} s`);
    $("facts").replaceChildren(...[
      ["Object", extraction.object.replaceAll("_", " ")],
      ["Length", seconds(extraction.duration_s)],
      ["Detected impact", seconds(extraction.detected_impact_s)],
      ["Nominal impact", seconds(extraction.nominal_impact_s)],
      ["Exclusion", `${(1000 * extraction.exclusion_s).toFixed(0)} ms to each side`],
      ["Let go", seconds(extraction.release_s)],
    ].flatMap(([name, value]) => {
      const [term, text] = [document.createElement("dt"), document.createElement("dd")];
      term.textContent = name;
      text.textContent = value;
      return [term, text];
    }));
    this.showVerdict();
    this.draw();
  }

  showVerdict() {
    const { extraction, acceptance } = this.data;
    const words = { open: "Not decided yet.", accepted: "Accepted: trials may follow it.", rejected: "Rejected: no trial follows it." };
    const problem = extraction.problem ? `No reference can be made: ${extraction.problem}.` : null;
    $("verdict").textContent = problem ?? words[acceptance.verdict];
    $("verdict").dataset.tone = problem || acceptance.verdict === "rejected" ? "bad" : acceptance.verdict === "accepted" ? "good" : "";
    $("accept").disabled = extraction.problem !== null;
    $("accept").title = extraction.problem ?? "Offer it to trials";
  }

  draw() {
    const { extraction } = this.data;
    const marks = [];
    if (extraction.nominal_impact_s !== null) {
      const at = extraction.nominal_impact_s;
      marks.push(band(at - extraction.exclusion_s, at + extraction.exclusion_s, colour("--interim")), rule(at, colour("--text"), "solid"));
    }
    if (extraction.detected_impact_s !== null) marks.push(rule(extraction.detected_impact_s, colour("--stopping"), "dot"));
    const options = { responsive: true, displaylogo: false, displayModeBar: false };
    const close = (curves) => SIDES.flatMap((side) => [
      line(extraction.t_s, curves[side].recorded, "recorded", side, "solid", 2),
      line(extraction.t_s, curves[side].ante, "ante-impact", side, "dash"),
      line(extraction.t_s, curves[side].post, "post-impact", side, "dot"),
    ]);
    const whole = (curves) => SIDES.map((side) => line(extraction.whole_t_s, curves[side], "recorded", side, "solid"));
    const limits = (curves) => {
      const values = SIDES.flatMap((side) => curves[side].recorded);
      return values.length ? [Math.min(...values), Math.max(...values)] : null;
    };
    for (const [place, traces, title, around] of [
      ["velocity", close(extraction.velocity), "Velocity along y around the impact, m/s", extraction.velocity],
      ["force", close(extraction.force), "Desired force along y around the impact, N", extraction.force],
      ["whole-velocity", whole(extraction.whole_velocity), "Velocity along y, all of it, m/s", null],
      ["whole-force", whole(extraction.whole_force), "Desired force along y, all of it, N", null],
    ]) {
      const picture = layout(title, marks);
      const range = around && limits(around);
      if (range) {
        const room = 0.25 * (range[1] - range[0] || 1);
        picture.yaxis.range = [range[0] - room, range[1] + room];
      }
      Plotly.react($(place), traces, picture, options);
    }
  }

  async say(verdict) {
    const acceptance = { name: $("name").value.trim(), note: $("note").value, verdict, nominal_impact_s: this.tried };
    try {
      this.data.acceptance = this.acceptance = await post(`/api/recordings/${id}`, acceptance);
      this.showVerdict();
    } catch (error) {
      showError(`Not ${verdict === "open" ? "kept" : verdict}: ${error.message}. The recording stays as it was.`);
    }
  }

  async discard() {
    if (!confirm("Remove this recording's file? It cannot be brought back.")) return;
    try {
      await post(`/api/recordings/${id}/discard`);
      location.href = "/";
    } catch (error) {
      showError(`Not discarded: ${error.message}`);
    }
  }
}

startPlayback(id, startFrame());
new Page().load();
