// The page Operate: puts its parts together.

import { Control } from "./control.js";
import { startFrame } from "./frame.js";
import { Jobs } from "./jobs.js";
import { Logs } from "./logs.js";
import { startScene } from "./scene.js";
import { startTabs } from "./tabs.js";
import { Teleoperate } from "./teleoperate.js";

const live = startFrame();
new Control(live);
const logs = new Logs((count) => jobs.setRecordings(count));
const jobs = new Jobs(live, () => logs.refresh());
logs.refresh();
new Teleoperate(live);
startTabs(document.getElementById("tabs"));
startScene();
