// A recording: what is extracted from it, the impact's time by hand, and what a person says about it.

import { get, post } from "./api.js";
import { ask } from "./dialog.js";
import { showError } from "./errors.js";
import { startFrame } from "./frame.js";
import { startPlayback } from "./playback.js";
import { RecordingPlot } from "./recording_plot.js";

const $ = (id) => document.getElementById(id);
const id = document.querySelector("main").dataset.id;
const SIDES = ["left", "right"];
const PLOTS = ["velocity", "force", "whole-velocity", "whole-force"];
const ROOM = 0.25; // of what was recorded, above and below it: references that are extended far leave the picture
const PARTS = [["recorded", "solid", 2], ["ante", "dash", 1.5], ["post", "dot", 1.5]]; // name, dash, width

class Page {
  constructor() {
    this.tried = null; // an impact's time that is looked at and not kept
    this.acceptance = null;
    this.plots = new Map(PLOTS.map((name) => [name, new RecordingPlot($(name))]));
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
    const [bands, rules] = [[], []];
    if (extraction.nominal_impact_s !== null) {
      const at = extraction.nominal_impact_s;
      bands.push({ from: at - extraction.exclusion_s, to: at + extraction.exclusion_s, colour: "mode-interim" });
      rules.push({ at, colour: "text", dash: [] });
    }
    if (extraction.detected_impact_s !== null) rules.push({ at: extraction.detected_impact_s, colour: "stopping", dash: [2, 3] });
    for (const [name, curves] of [["velocity", extraction.velocity], ["force", extraction.force]]) {
      const lines = SIDES.flatMap((side) => PARTS.map(([part, dash, width]) => ({ side, y: curves[side][part], colour: side, dash, width })));
      const recorded = SIDES.flatMap((side) => curves[side].recorded);
      const [low, high] = [Math.min(...recorded), Math.max(...recorded)];
      const room = ROOM * (high - low || 1);
      const range = recorded.length ? [low - room, high + room] : null;
      this.plots.get(name).show({ t: extraction.t_s, curves: lines, range, bands, rules });
    }
    for (const [name, curves] of [["whole-velocity", extraction.whole_velocity], ["whole-force", extraction.whole_force]]) {
      const lines = SIDES.map((side) => ({ side, y: curves[side], colour: side, dash: "solid", width: 1.5 }));
      this.plots.get(name).show({ t: extraction.whole_t_s, curves: lines, range: null, bands, rules });
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
    const details = "Its file is removed from the folder of logs and cannot be brought back.";
    if (!(await ask({ question: "Discard this recording?", details, yes: "Discard", bad: true }))) return;
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
