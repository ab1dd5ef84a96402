// What every page has: theme, keys, live state, STOP, the top bar and the strip of events. Returns the live state.

import { startBar } from "./bar.js";
import { startClutch } from "./clutch.js";
import { startErrors } from "./errors.js";
import { startEvents } from "./events.js";
import { startLabels } from "./labels.js";
import { Live } from "./live.js";
import { startKeyboard } from "./keyboard.js";
import { startNumbers } from "./numbers.js";
import { startRequest } from "./request.js";
import { startStop } from "./stop.js";
import { startTheme } from "./theme.js";

export function startFrame() {
  startTheme();
  startKeyboard();
  startNumbers();
  startLabels();
  const live = new Live();
  startStop(live);
  startBar(live);
  startErrors(live);
  startEvents(live);
  startClutch(live);
  startRequest(live);
  return live;
}
