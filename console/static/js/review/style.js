// Colours and dashes of curves, from the page's own tokens: left arm blue, right arm orange, measured solid,
// reference dashed, desired dotted; compared logs by dashes of their own.

import { token } from "../theme.js";

// the last five are compared logs'
export const DASHES = { solid: [], dash: [9, 6], dot: [2, 3], long: [12, 5], dots: [2, 4], dashdot: [9, 4, 2, 4], short: [5, 4], dashdotdot: [14, 4, 2, 4, 2, 4] };
const OVERLAYS = Object.keys(DASHES).slice(-5);
const LEVELS = { WARNING: "amber", ERROR: "red", FATAL: "red", NOTE: "accent" };

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

// The look of the `place`-th compared log: a colour and a dash of its own, the right arm thicker, what is followed fainter.
export const overlayLook = (place, right, follows) => ({ colour: token(`overlay-${place + 1}`), dash: OVERLAYS[place], width: right ? 2.5 : 1.25, opacity: follows ? 0.5 : 1 });

// A piece of line as the legend of a curve; colour null: that of the `place`-th compared log, by the style sheet.
export function swatch(dash, colour, place = null) {
  const picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  picture.setAttribute("viewBox", "0 0 26 8");
  picture.setAttribute("class", "swatch");
  picture.ariaHidden = "true";
  if (place !== null) picture.dataset.place = place + 1;
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  const look = { x1: 0, x2: 26, y1: 4, y2: 4, "stroke-width": 2.5, "stroke-dasharray": DASHES[dash].map((part) => part * 0.7).join(" ") || "none", ...(colour && { stroke: colour }) };
  for (const [name, value] of Object.entries(look)) line.setAttribute(name, value);
  picture.append(line);
  return picture;
}

export const overlaySwatch = (place) => swatch(OVERLAYS[place], null, place);

export function dashOf(signal) {
  if (/_ref$|_ff$/.test(signal.field)) return "dash";
  return /_desired$|_d$/.test(signal.field) ? "dot" : "solid";
}
