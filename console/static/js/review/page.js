// The review of one log: puts its parts together.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { startFrame } from "../frame.js";
import { startMenus } from "../menus.js";
import { startPlayback } from "../playback.js";
import { startScene } from "../scene.js";
import { showAnalyses, signalsOf } from "./analyses.js";
import { modesOf } from "./bands.js";
import { Cameras } from "./cameras.js";
import { Compare } from "./compare.js";
import { startKeys } from "./keys.js";
import { showLateness } from "./lateness.js";
import { Layouts } from "./layouts.js";
import { Marks } from "./marks.js";
import { Notes } from "./notes.js";
import { Plots } from "./plots.js";
import { startPrint } from "./print.js";
import { Scrub } from "./scrub.js";
import { Log } from "./source.js";
import { Timeline } from "./timeline.js";
import { Tree } from "./tree.js";
import { Values } from "./values.js";
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

// The names of the signals that a log can have: none of an arm that it does not have, and none of a pair where it has one.
function namesIn({ topics }, signals) {
  const one = !("/left/arm" in topics && "/right/arm" in topics);
  const there = signals.filter(({ topic, field }) => topic in topics && !(one && field.startsWith("pair_")));
  if (one) for (const signal of there) if (signal.whose === "both arms") signal.whose = signal.group;
  return new Set(there.map(({ name }) => name));
}

const legend = [...document.querySelectorAll(".modes li")];
export let plots = null; // for readers of what is drawn

async function start() {
  const live = startFrame();
  startMenus();
  const view = new View();
  const log = new Log(main.dataset.id);
  const signals = await get("/api/logs/signals");
  const tree = new Tree(view, signals);
  plots = new Plots(view, signals, log);
  const marks = new Marks(view, log);
  const timeline = new Timeline(view, log, marks);
  const compare = new Compare(view, log, plots);
  const ghostSwitch = document.createElement("button");
  Object.assign(ghostSwitch, { type: "button", className: "quiet", id: "ghost-switch", textContent: "ghost: on", title: "The compared log in the scene", hidden: true });
  element("home").parentElement.append(ghostSwitch);
  let ghostShown = true;
  const values = new Values((id) => compare.nameOf(id));
  const compared = () => ({ others: plots.others.map(({ log: { id }, offset }) => ({ id, offset })), ghost: ghostShown });
  const layouts = new Layouts(view, log);
  const scrub = new Scrub(view, log, compared, (answer) => {
    plots.legends.showValues(answer.values);
    values.write([answer.values, ...compare.at(answer, ghostShown)], answer.t);
  });
  ghostSwitch.addEventListener("click", () => {
    ghostShown = !ghostShown;
    ghostSwitch.textContent = `ghost: ${ghostShown ? "on" : "off"}`;
    scrub.ask();
  });
  for (const what of ["other", "signals"]) view.on(what, () => values.show(plots.signals, plots.others));
  view.on("other", () => {
    ghostSwitch.hidden = plots.others.length === 0;
    if (ghostSwitch.hidden) compare.ghost.hidden = true;
  });
  plots.shown.then(() => {
    element("full").disabled = false; // before there are curves it would do nothing
    compare.offer(); // curves first
    layouts.offer();
    startScene((detail) => `/viser/review/${detail}/${scrub.key}/`);
  });
  startPlayback(log.id, live);
  const cameras = new Cameras(view, log);
  const notes = new Notes(view, log, marks, () => {
    marks.show();
    timeline.draw();
    plots.draw();
  });
  notes.load();
  startKeys(view, timeline, marks, cameras, notes);

  const link = () => {
    const none = !view.known || view.signals.length === 0 || plots.drawn === null;
    const [first] = plots.others;
    const shown = { signals: view.signals.join(","), start: view.from, end: view.to };
    const table = { ...shown, signals: [...new Set([...view.signals, ...(view.across ? [view.across] : [])])].join(",") };
    const others = plots.others.map((other) => `${other.log.id}:${other.offset}`).join(",");
    const drawn = { ...shown, ...(others && { others }), reference: view.reference, difference: plots.differs };
    const addresses = { csv: ["csv", { ...table, ...(first && { other: first.log.id, offset: first.offset }) }] };
    for (const form of ["pdf", "svg", "png"]) addresses[form] = ["figure", { ...drawn, form }];
    for (const [id, [what, query]] of Object.entries(addresses)) {
      const [item, overTime] = [element(id), view.across !== null && id !== "csv"];
      item.dataset.title ??= item.title;
      item.title = overTime ? "A figure is drawn over time: choose time in Across" : item.dataset.title;
      item.ariaDisabled = none || overTime;
      if (none || overTime) item.removeAttribute("href");
      else item.href = `/api/logs/${log.id}/${what}?${new URLSearchParams(query)}`;
    }
  };
  view.on("window", link);
  view.on("signals", link);
  view.on("other", link);
  plots.shown.then(link);
  element("full").addEventListener("click", () => view.setWindow(0, view.end));
  startPrint(() => plots.draw());

  let names = null;
  let later = []; // of the address, and of no log as it is recorded: perhaps an analysis gives them
  const sinceMs = performance.now();
  await log.read((document) => {
    showRow(document);
    showReading(document, sinceMs);
    if (names === null) {
      names = namesIn(document, signals);
      later = view.signals.filter((name) => !signals.some((signal) => signal.name === name));
      tree.keep(names);
      view.keep(names);
      tree.offer(signals.filter(({ name }) => names.has(name)));
    }
    view.setEnd(document.duration_s);
    if (document.done) {
      const given = signalsOf(document);
      tree.build(given);
      plots.know(given);
      for (const { name } of given) names.add(name);
      tree.offer(given);
      view.signals = [...view.signals, ...later.filter((name) => names.has(name))];
      view.tell("signals");
      showAnalyses(document);
    }
    for (const item of legend) item.hidden = !modesOf(document).some(([, , mode]) => mode === item.dataset.mode);
    marks.update();
    timeline.draw();
    plots.refresh();
    link();
  });
  await cameras.start().catch((error) => showError(`The pictures of this log are not shown: ${error.message}`));
  showLateness(log, view).catch((error) => showError(`Who was late in this log is not known: ${error.message}`));
}

start().catch((error) => showError(`This log is not shown: ${error.message}`));
