// Colours and dashes of curves, from the page's own tokens: left arm blue, right arm orange, measured solid,
// reference dashed, desired dotted.

import { token } from "../theme.js";

const LEVELS = { WARNING: "amber", ERROR: "red", FATAL: "red" };

const channels = (colour) => [1, 3, 5].map((place) => parseInt(colour.slice(place, place + 2), 16));
const mixed = (colour, other, share) => {
  const [a, b] = [channels(colour), channels(other)];
  return `#${a.map((value, place) => Math.round(value + (b[place] - value) * share).toString(16).padStart(2, "0")).join("")}`;
};

export const eventColour = (event) => token(LEVELS[event.level] ?? (event.name === "impact" ? "text" : "faint"));
export const theme = () => ({ text: token("text"), faint: token("faint"), line: token("line"), surface: token("surface"), font: token("font") });

// `place`: which of its family in the pane it is. On a light ground the families are darker: a line has to be seen.
export function colourOf(signal, place) {
  const light = document.documentElement.dataset.theme === "light";
  const base = signal.whose === "left" ? token("left") : signal.whose === "right" ? token("right") : token("good");
  const strong = light ? mixed(base, "#101010", 0.15) : base;
  return mixed(strong, light ? "#9aa0a6" : "#f4f6f8", Math.min(place * 0.16, 0.7));
}

// Of the log that was put over the first one as the `place`-th: one scale, and none of the arms' colours.
export const overlayColour = (place) => token(`overlay-${place + 1}`);

export function dashOf(signal) {
  if (/_ref$|_ff$/.test(signal.field)) return "dash";
  return /_desired$|_d$/.test(signal.field) ? "dot" : "solid";
}
