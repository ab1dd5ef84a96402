// A page without a script of its own.

import { startFrame } from "./frame.js";

startFrame();
