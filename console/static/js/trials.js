// The page Trials: puts its parts together.

import { Control } from "./control.js";
import { startFrame } from "./frame.js";
import { startJobLine } from "./job_line.js";
import { showWhy } from "./jobs.js";
import { Means } from "./means.js";
import { remember } from "./memory.js";
import { startMenus } from "./menus.js";
import { Queue } from "./queue.js";
import { References } from "./references.js";
import { Remarks } from "./remarks.js";
import { startStrips } from "./strips.js";
import { SweepForm } from "./sweep_form.js";
import { startTabs } from "./tabs.js";
import { TrialTable } from "./trial_table.js";

const $ = (id) => document.getElementById(id);
const live = startFrame();
new Control(live);
const form = $("trial");
const sweep = new SweepForm(form);
remember("sweep", form.elements);
const boxes = [...form.querySelectorAll("[name=objects]")];
const references = new References(form, boxes, (object) => {
  if (!boxes.some((box) => box.value === object)) return;
  for (const box of boxes) box.checked = box.value === object;
  sweep.changed();
});
const means = new Means();
const queue = new Queue(live, (entries, mine) => {
  means.follow(entries);
  trials.follow(entries, mine);
  sweep.changed(); // the room that is left
});
const remarks = new Remarks(() => trials.refresh());
const asked = () => ({ q: $("filter").value.trim(), outcome: $("outcome").value });
const trials = new TrialTable($("logs"), asked, $("filter-why"), (path, body) => queue.change(path, body), (log) => remarks.ask([log]));
for (const id of ["filter", "outcome"]) $(id).addEventListener("input", () => trials.search());
$("table-csv").addEventListener("click", () => trials.saveCsv("trials.csv"));
startMenus();
references.refresh().then(() => sweep.measure());
startJobLine(live, () => {
  trials.refresh();
  references.refresh();
  queue.refresh();
});
startStrips(live);

startTabs($("queue-tabs"));
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  sweep.refuse(await queue.add(sweep.order()));
});
live.onView(({ status, you }) => {
  const lease = status?.holder === you ? null : "take control first, then fill the queue";
  const missing = references.count ? null : "no reference yet: record and accept one, or plan one with rtstack plan";
  showWhy(form, lease ?? missing ?? (sweep.wrong ? "correct what is marked" : null), sweep.words);
});
