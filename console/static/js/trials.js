// The page Trials: puts its parts together.

import { Control } from "./control.js";
import { startFrame } from "./frame.js";
import { startJobLine } from "./job_line.js";
import { bodyOf, showWhy } from "./jobs.js";
import { LogTable } from "./log_table.js";
import { Queue } from "./queue.js";
import { References } from "./references.js";
import { startStrips } from "./strips.js";

const $ = (id) => document.getElementById(id);
const live = startFrame();
new Control(live);
const form = $("trial");
const references = new References(form);
const queue = new Queue(live);
const results = new LogTable($("logs"), () => ({ q: $("filter").value.trim(), outcome: $("outcome").value }), { always: { kind: "trial" } });
for (const id of ["filter", "outcome"]) $(id).addEventListener("input", () => results.refresh());
$("table-csv").addEventListener("click", () => results.saveCsv("trials.csv"));
references.refresh();
startJobLine(live, () => {
  results.refresh();
  references.refresh();
  queue.refresh();
});
startStrips(live);

form.addEventListener("submit", (event) => {
  event.preventDefault();
  queue.add(bodyOf(form));
});
live.onView(({ status, you }) => {
  const lease = status?.holder === you ? null : "take control first: only the operator with control fills its queue";
  showWhy(form, lease ?? (references.count ? null : "no reference yet: record and accept one, or plan one with rtstack plan"));
});
