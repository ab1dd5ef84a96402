// The page Operate: puts its parts together.

import { startBar } from "./bar.js";
import { Control } from "./control.js";
import { startEvents } from "./events.js";
import { Jobs } from "./jobs.js";
import { Live } from "./live.js";
import { Logs } from "./logs.js";
import { startScene } from "./scene.js";
import { startStop } from "./stop.js";
import { startTheme } from "./theme.js";

startTheme();
const live = new Live();
startStop(live);
startBar(live);
startEvents(live);
new Control(live);
const logs = new Logs((count) => jobs.setRecordings(count));
const jobs = new Jobs(live, () => logs.refresh());
logs.refresh();
startScene();
