// Mode bands behind the curves and on the time line, events as ticks: drawn on a canvas, which does not mind how many.

import { eventColour, modeColour, theme } from "./style.js";

const ALPHA = 0.17;
const CROWD = 24; // events in sight: so many lines would hide the curves
const WORD_PX = 84; // a word needs as much room
const wordOf = (mode) => mode.toLowerCase().replace("_", "-");

function prepared(canvas) {
  const ratio = devicePixelRatio;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

// Spans that are narrower than half a pixel are passed over: their neighbours are at the same place.
function drawModes(context, spans, x, left, right, top, height, alpha, words) {
  let drawn = left;
  for (const [from, to, mode] of spans) {
    const [start, end] = [Math.max(x(from), drawn), Math.min(x(to), right)];
    if (end - start < 0.5) continue;
    drawn = end;
    context.globalAlpha = alpha;
    context.fillStyle = modeColour(mode);
    context.fillRect(start, top, end - start, height);
    if (words && end - start > WORD_PX) {
      context.globalAlpha = 1;
      context.fillStyle = theme().text;
      context.fillText(wordOf(mode), start + 6, top + height / 2);
    }
  }
  context.globalAlpha = 1;
}

// In the plots: area {left, right, top, bottom} px, x: time -> px.
export function drawBands(canvas, document, x, area, panes) {
  const { context } = prepared(canvas);
  if (!document) return;
  for (const { top, bottom } of panes) drawModes(context, document.modes.left ?? [], x, area.left, area.right, top, bottom - top, ALPHA, false);
  const inside = ({ t_s }) => x(t_s) >= area.left && x(t_s) <= area.right;
  const told = document.events.filter((event) => (event.name !== "mode" || event.level !== "INFO") && inside(event));
  for (const event of told) {
    const place = x(event.t_s);
    context.strokeStyle = eventColour(event);
    context.setLineDash(event.name === "impact" || event.name === "verdict" ? [] : [2, 4]);
    context.globalAlpha = told.length > CROWD ? 0.25 : 0.75;
    context.beginPath();
    context.moveTo(Math.round(place) + 0.5, area.top);
    context.lineTo(Math.round(place) + 0.5, area.bottom);
    context.stroke();
  }
  context.setLineDash([]);
  if (told.length <= CROWD) labels(context, told, x, area);
}

// Impacts and verdicts in words, at the foot, where there is room for them.
function labels(context, events, x, area) {
  context.globalAlpha = 1;
  context.font = `11px ${theme().font}`;
  context.textBaseline = "bottom";
  let free = area.left;
  for (const event of events.filter(({ name }) => name === "impact" || name === "verdict")) {
    const place = x(event.t_s);
    const text = event.name === "impact" ? "impact" : event.text;
    const width = context.measureText(text).width;
    if (place < Math.max(free, area.left) || place + width + 8 > area.right) continue;
    context.fillStyle = theme().surface;
    context.fillRect(place + 2, area.bottom - 17, width + 6, 15);
    context.fillStyle = eventColour(event);
    context.fillText(text, place + 5, area.bottom - 3);
    free = place + width + 12;
  }
}

// The whole log on one line, with what the plots show framed.
export function drawOverview(canvas, document, view) {
  const { context, width, height } = prepared(canvas);
  const x = (t) => (t / view.end) * width;
  context.font = `11px ${theme().font}`;
  context.textBaseline = "middle";
  context.fillStyle = theme().line;
  context.fillRect(0, 0, width, height);
  if (document) {
    context.fillStyle = theme().surface;
    context.fillRect(0, 0, x(document.share * view.end), height);
    drawModes(context, document.modes.left ?? [], x, 0, width, 0, height, 0.5, true);
    let last = -2;
    for (const event of document.events) {
      if (event.name === "mode" && event.level === "INFO") continue;
      const place = Math.round(x(event.t_s));
      if (place - last < 2) continue;
      last = place;
      context.fillStyle = eventColour(event);
      context.fillRect(place, 0, 1, height);
    }
  }
  context.strokeStyle = theme().text;
  context.lineWidth = 1.5;
  context.strokeRect(x(view.from ?? 0) + 0.75, 0.75, Math.max(x((view.to ?? view.end) - (view.from ?? 0)) - 1.5, 2), height - 1.5);
}
