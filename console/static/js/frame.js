// What every page has: theme, live state, STOP, the top bar and the strip of events. Returns the live state.

import { startBar } from "./bar.js";
import { startEvents } from "./events.js";
import { Live } from "./live.js";
import { startStop } from "./stop.js";
import { startTheme } from "./theme.js";

export function startFrame() {
  startTheme();
  const live = new Live();
  startStop(live);
  startBar(live);
  startEvents(live);
  return live;
}
