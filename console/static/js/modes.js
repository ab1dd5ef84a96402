// The modes' words and colours, as the console serves them: no list of them is kept here.

import { token } from "./theme.js";

const WORDS = { ...JSON.parse(document.getElementById("bar").dataset.modes), UNKNOWN: "no state" };

export const wordOf = (mode) => WORDS[mode] ?? mode.toLowerCase().replaceAll("_", "-");

export const modeColour = (mode) => token(`mode-${mode.toLowerCase().replaceAll("_", "-")}`) || token("idle");
