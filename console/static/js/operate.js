// The page Operate: puts its parts together.

import { TWO } from "./arms.js";
import { startCalibration } from "./calibrate.js";
import { Control } from "./control.js";
import { startDesk } from "./desk.js";
import { startFrame } from "./frame.js";
import { startGhost } from "./ghost.js";
import { startJobLine } from "./job_line.js";
import { Jobs } from "./jobs.js";
import { LogTable } from "./log_table.js";
import { remember } from "./memory.js";
import { startMenus } from "./menus.js";
import { startMoves } from "./moves.js";
import { Plan } from "./plan.js";
import { startPlanner } from "./planner.js";
import { Policies } from "./policies.js";
import { References } from "./references.js";
import { startScene } from "./scene.js";
import { startStrips } from "./strips.js";
import { startTabs } from "./tabs.js";
import { Teleoperate } from "./teleoperate.js";
import { startTraining } from "./training.js";

const live = startFrame();
startMenus();
const filter = document.getElementById("filter");
new Control(live);
const trial = document.getElementById("trial"); // what a grab takes is there for two arms alone
let references = null;
if (TWO) {
  for (const form of [trial, ...["demonstration", "plan"].map((id) => document.getElementById(id))]) remember(form.id, form.elements);
  references = new References(trial, [trial.elements.object], (object) => {
    if ([...trial.elements.object.options].some((option) => option.value === object)) trial.elements.object.value = object;
  });
}
const logs = new LogTable(document.getElementById("logs"), () => ({ q: filter.value.trim() }), { why: document.getElementById("filter-why") });
filter.addEventListener("input", () => logs.search());
if (TWO) new Jobs(live, references);
references?.refresh();
// A trial is to follow this log: its form, with the reference chosen.
const follow = async (id) => {
  logs.refresh();
  document.getElementById("tab-trial").click();
  await references.refresh(id);
  trial.querySelector("[type=submit]").focus();
};
startJobLine(live, () => {
  logs.refresh();
  references?.refresh();
}, follow);
startDesk(live);
startStrips(live);
if (TWO) startGhost(trial, live);
startMoves(document.getElementById("moves"), live);
new Teleoperate(live);
new Policies(live);
if (TWO) new Plan(trial, live);
if (TWO) startPlanner(document.getElementById("plan"), follow);
const training = document.getElementById("training");
if (training) startTraining(training, live);
startCalibration(document.getElementById("calibration"));
startTabs(document.getElementById("tabs"));
startScene();

// From the top of the page to the next step.
const skip = document.createElement("a");
skip.className = "skip";
skip.href = "#control";
skip.textContent = "To the next step";
skip.addEventListener("click", (event) => {
  event.preventDefault();
  const runs = [...document.querySelectorAll("main .act")].find((each) => each.checkVisibility() && !each.disabled);
  (document.querySelector(".slot .next") ?? runs ?? document.querySelector(".slot button[data-away=false]:not(#release)")).focus();
});
document.body.prepend(skip);
