// The page Operate: puts its parts together.

import { Control } from "./control.js";
import { startFrame } from "./frame.js";
import { startJobLine } from "./job_line.js";
import { Jobs } from "./jobs.js";
import { LogTable } from "./log_table.js";
import { References } from "./references.js";
import { startScene } from "./scene.js";
import { startStrips } from "./strips.js";
import { startTabs } from "./tabs.js";
import { Teleoperate } from "./teleoperate.js";

const live = startFrame();
const filter = document.getElementById("filter");
new Control(live);
const references = new References(document.getElementById("trial"));
const logs = new LogTable(document.getElementById("logs"), () => ({ q: filter.value.trim() }));
filter.addEventListener("input", () => logs.refresh());
new Jobs(live, references);
references.refresh();
startJobLine(live, () => {
  logs.refresh();
  references.refresh();
});
startStrips(live);
new Teleoperate(live);
startTabs(document.getElementById("tabs"));
startScene();
