// The page without a session: STOP alone, for a browser that was signed in before.

import { startStop } from "./stop.js";

startStop(null);
