// The review of one log: puts its parts together.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { startFrame } from "../frame.js";
import { startPlayback } from "../playback.js";
import { startScene } from "../scene.js";
import { Compare } from "./compare.js";
import { startKeys } from "./keys.js";
import { Marks } from "./marks.js";
import { savePicture } from "./picture.js";
import { Plots } from "./plots.js";
import { Scrub } from "./scrub.js";
import { Log } from "./source.js";
import { Timeline } from "./timeline.js";
import { Tree } from "./tree.js";
import { View } from "./view.js";

const SLOW_MS = 400; // what takes less needs no line
const main = document.getElementById("review");
const element = (id) => document.getElementById(id);

function showRow({ row, trial, condition }) {
  element("outcome").textContent = row.outcome;
  element("outcome").title = row.outcome;
  element("outcome").dataset.outcome = row.success === null ? "none" : row.success ? "success" : "failure";
  const words = [row.kind, row.controller, row.object, row.displacement_mm === null ? null : `${row.displacement_mm} mm`, row.seed === null ? null : `seed ${row.seed}`, trial?.cell, condition === "truncated" ? "cut off" : null, row.note];
  element("what").textContent = words.filter(Boolean).join(", ").replaceAll("_", " ");
  element("what").title = element("what").textContent;
}

function showReading(document, sinceMs) {
  const seconds = (performance.now() - sinceMs) / 1000;
  element("reading").hidden = document.done || seconds * 1000 < SLOW_MS;
  element("share").value = document.share;
  element("reading-line").textContent = `Reading this log for the first time: ${Math.round(document.share * 100)} % after ${seconds.toFixed(0)} s. What has been read is shown; leave this page whenever you like.`;
}

export let plots = null; // for readers of what is drawn

async function start() {
  const live = startFrame();
  const view = new View();
  const log = new Log(main.dataset.id);
  const signals = await get("/api/logs/signals");
  new Tree(view, signals);
  plots = new Plots(view, signals, log);
  const marks = new Marks(view, log);
  const timeline = new Timeline(view, log, marks);
  const compare = new Compare(view, log, plots);
  const ghostSwitch = document.createElement("button");
  Object.assign(ghostSwitch, { type: "button", className: "quiet", id: "ghost-switch", textContent: "ghost: on", title: "The compared log in the scene", hidden: true });
  element("home").parentElement.append(ghostSwitch);
  let ghostShown = true;
  const ghost = () => (plots.other === null || !ghostShown ? null : { id: plots.other.log.id, offset: plots.other.offset });
  const scrub = new Scrub(view, log, ghost, (answer) => plots.legends.showValues(answer.values, compare.showGhost(answer)));
  ghostSwitch.addEventListener("click", () => {
    ghostShown = !ghostShown;
    ghostSwitch.textContent = `ghost: ${ghostShown ? "on" : "off"}`;
    scrub.ask();
  });
  view.on("other", () => {
    ghostSwitch.hidden = plots.other === null;
  });
  plots.shown.then(() => {
    for (const id of ["full", "png"]) element(id).disabled = false; // before there are curves they would do nothing
    compare.offer(); // curves first
    startScene((detail) => `/viser/review/${detail}/${scrub.key}/`);
  });
  startPlayback(log.id, live);
  startKeys(view, timeline, marks);

  const link = () => {
    const other = plots.other === null ? "" : `&other=${plots.other.log.id}&offset=${plots.other.offset}`;
    const none = !view.known || view.signals.length === 0;
    element("csv").ariaDisabled = none;
    if (none) element("csv").removeAttribute("href");
    else element("csv").href = `/api/logs/${log.id}/csv?signals=${view.signals.join(",")}&start=${view.from}&end=${view.to}${other}`;
  };
  view.on("window", link);
  view.on("signals", link);
  view.on("other", link);
  element("full").addEventListener("click", () => view.setWindow(0, view.end));
  element("png").addEventListener("click", () => savePicture(plots, main.dataset.name, compare.said).catch((error) => showError(`No picture was made: ${error.message}`)));

  const sinceMs = performance.now();
  await log.read((document) => {
    showRow(document);
    showReading(document, sinceMs);
    view.setEnd(document.duration_s);
    marks.update();
    timeline.draw();
    plots.refresh();
    link();
  });
}

start().catch((error) => showError(`This log is not shown: ${error.message}`));
