// A recording: what is extracted from it, the part that is used and the impact's time by hand, and what a person says
// about it.

import { get, post } from "./api.js";
import { ask } from "./dialog.js";
import { Episodes } from "./episodes.js";
import { showError } from "./errors.js";
import { startFrame } from "./frame.js";
import { allRead, numberOf } from "./numbers.js";
import { startPlayback } from "./playback.js";
import { RecordingPlot } from "./recording_plot.js";
import { remarkText } from "./worth.js";

const $ = (id) => document.getElementById(id);
const id = document.querySelector("main").dataset.id;
const SIDES = ["left", "right"];
const PLOTS = ["velocity", "force", "whole-velocity", "whole-force"];
const ROOM = 0.25; // of what was recorded, above and below it: references that are extended far leave the picture
const PARTS = [["recorded", "solid", 2], ["ante", "dash", 1.5], ["post", "dot", 1.5]]; // name, dash, width

const POLL_MS = 400;
const FIELDS = { nominal_impact_s: "impact", from_s: "from", to_s: "to" }; // of an acceptance, and where they are typed

function remark(said) {
  const item = document.createElement("li");
  item.dataset.tone = said.good ? "good" : "bad";
  item.textContent = remarkText(said);
  return item;
}

class Page {
  constructor(episodes) {
    this.episodes = episodes;
    this.tried = {}; // what is looked at and not kept, of FIELDS
    this.acceptance = null;
    this.data = null;
    this.asked = 0;
    this.plots = new Map(PLOTS.map((name) => [name, new RecordingPlot($(name))]));
    for (const [key, id] of Object.entries(FIELDS)) {
      $(id).addEventListener("change", () => this.look({ [key]: $(id).value === "" ? null : numberOf($(id)) }));
    }
    $("detected").addEventListener("click", () => this.look({ nominal_impact_s: null }));
    $("trim").addEventListener("click", () => this.trim());
    $("untrim").addEventListener("click", () => this.look({ from_s: null, to_s: null }));
    $("accept").addEventListener("click", () => this.say("accepted"));
    $("reject").addEventListener("click", () => this.say("rejected"));
    $("keep").addEventListener("click", () => this.say(this.acceptance.verdict));
    $("discard").addEventListener("click", () => this.discard());
    $("theme").addEventListener("click", () => this.data && this.draw());
    window.addEventListener("keydown", (event) => this.key(event));
    this.decidable(false);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
    if (event.target.closest?.("input, textarea, select") || document.querySelector("dialog[open]")) return;
    const buttons = { a: "accept", x: "reject", r: "retake", d: "discard", t: "trim" };
    if (event.key in buttons) $(buttons[event.key]).click();
    if (event.key === "[") this.episodes.go(1);
    if (event.key === "]") this.episodes.go(-1);
  }

  decidable(yes) {
    for (const id of ["accept", "reject", "keep", "trim", "untrim", "detected"]) $(id).disabled = !yes;
  }

  // The extraction for what is tried, or for what is kept; how far it is meanwhile.
  async load(first = true) {
    const asked = (this.asked += 1);
    const given = Object.entries(this.tried).filter(([, value]) => value !== null);
    const query = new URLSearchParams([...given, ["tried", !first], ["wait", false]]);
    for (;;) {
      const data = await get(`/api/recordings/${id}?${query}`);
      if (asked !== this.asked) return; // something else is looked at meanwhile
      if (first && this.acceptance === null) this.fill(data.acceptance);
      if (data.extraction !== null) return this.show(data);
      $("extracted").hidden = false;
      $("extracted").value = data.share;
      this.tell(`The references are being extracted: ${Math.round(100 * data.share)} %.`, "");
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
    }
  }

  async start() {
    try {
      await this.load();
    } catch (error) {
      this.tell(error.message, "bad");
      $("extracted").hidden = true;
      showError(`This recording cannot be shown: ${error.message}`);
    }
  }

  async look(changed) {
    Object.assign(this.tried, changed);
    for (const [key, id] of Object.entries(FIELDS)) $(id).value = this.tried[key] ?? "";
    try {
      await this.load(false);
    } catch (error) {
      $("extracted").hidden = true;
      this.tell(error.message, "bad");
      showError(`Not extracted again: ${error.message}`);
    }
  }

  // Use the part that one of the plots of all of it shows.
  trim() {
    const zoomed = ["whole-velocity", "whole-force"].map((name) => this.plots.get(name)).find((plot) => plot.from > plot.begin || plot.to < plot.end);
    if (!zoomed) return showError("Zoom in a plot of all of it first: by the wheel, or by a drag over the part to use.");
    const seconds = (value) => Math.round(1000 * value) / 1000;
    this.look({ from_s: zoomed.from > zoomed.begin ? seconds(zoomed.from) : null, to_s: zoomed.to < zoomed.end ? seconds(zoomed.to) : null });
  }

  fill(acceptance) {
    this.acceptance = acceptance;
    $("name").value = acceptance.name;
    $("note").value = acceptance.note;
    for (const [key, id] of Object.entries(FIELDS)) {
      this.tried[key] = acceptance[key];
      $(id).value = acceptance[key] ?? "";
      if (acceptance[key] !== null) $("part").open = true;
    }
  }

  show(data) {
    this.data = data;
    const { extraction } = data;
    for (const id of Object.values(FIELDS)) $(id).dataset.max = Math.ceil(extraction.whole_t_s.at(-1) ?? 999);
    $("extracted").hidden = true;
    this.decidable(true);
    $("impact").placeholder = extraction.detected_impact_s === null ? "none found" : extraction.detected_impact_s.toFixed(3);
    const seconds = (value) => (value === null ? "none" : `${value.toFixed(3)} s`);
    $("facts").replaceChildren(...[
      ["Object", extraction.object.replaceAll("_", " ")],
      ["Used", `${seconds(extraction.begin_s)} to ${seconds(extraction.end_s)}`],
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
    $("remarks").replaceChildren(...extraction.remarks.map(remark));
    this.showVerdict();
    this.draw();
  }

  tell(text, tone) {
    if ($("verdict").textContent !== text) $("verdict").textContent = text;
    $("verdict").dataset.tone = tone;
  }

  showVerdict() {
    const { extraction } = this.data;
    const words = { open: "Not decided yet.", accepted: "Accepted: trials may follow it.", rejected: "Rejected: no trial follows it." };
    const tones = { open: "", accepted: "good", rejected: "bad" };
    const { verdict } = this.acceptance;
    const changed = Object.keys(FIELDS).some((key) => this.tried[key] !== this.acceptance[key]);
    const stays = changed && verdict === "accepted" ? " What was accepted stays as it was until another part is accepted." : "";
    this.episodes.mark(extraction.problem !== null);
    if (extraction.problem !== null) $("part").open = true;
    if (extraction.problem) this.tell(`No reference can be made: ${extraction.problem}.${stays}`, "bad");
    else this.tell(words[verdict] + (changed ? " The impact or the part is changed, and not kept yet." : ""), tones[verdict]);
    $("accept").disabled = extraction.problem !== null;
    $("accept").title = extraction.problem ?? "Offer it to trials (A)";
    $("reject").title = "No trial follows it (X)";
    $("discard").title = "Move it to the deleted logs (D)";
  }

  draw() {
    const { extraction } = this.data;
    const [bands, rules] = [[], []];
    bands.push({ from: -Infinity, to: extraction.begin_s, colour: "faint", alpha: 0.35 });
    bands.push({ from: extraction.end_s, to: Infinity, colour: "faint", alpha: 0.35 });
    if (extraction.nominal_impact_s !== null) {
      const at = extraction.nominal_impact_s;
      bands.push({ from: at - extraction.exclusion_s, to: at + extraction.exclusion_s, colour: "mode-interim", alpha: 0.28 });
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
    if (!allRead()) return;
    const acceptance = { name: $("name").value.trim(), note: $("note").value, verdict, ...this.tried };
    this.tell({ accepted: "Accepting it.", rejected: "Rejecting it." }[verdict] ?? "Saving it.", "");
    this.decidable(false);
    try {
      this.acceptance = await post(`/api/recordings/${id}`, acceptance);
      this.episodes.show();
    } catch (error) {
      showError(`Not ${verdict === "open" ? "kept" : verdict}: ${error.message}. The recording stays as it was.`);
    }
    this.decidable(true);
    this.showVerdict();
  }

  async discard() {
    const details = "It goes to the deleted logs, from where the page Logs brings it back.";
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
const episodes = new Episodes(id);
new Page(episodes).start();
episodes.show().catch((error) => showError(`The list of recordings is not there: ${error.message}`));
