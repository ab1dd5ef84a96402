// Mode bands behind the curves and on the time line, events as ticks: drawn on a canvas, which does not mind how many.

import { pen } from "../canvas.js";
import { modeColour, wordOf } from "../modes.js";
import { eventColour, theme } from "./style.js";

const ALPHA = 0.17;
const CROWD = 24; // events in sight: so many lines would hide the curves
const isTold = ({ name }) => name === "impact" || name === "verdict" || name === "note";
const MOST_LETTERS = 32; // of a note
const WORD_PX = 84; // a word needs as much room

// Of the first arm that the log has.
export const modesOf = ({ modes }) => Object.values(modes)[0] ?? [];

// Spans that are narrower than half a pixel are passed over: their neighbours are at the same place.
export function drawModes(context, spans, x, left, right, top, height, alpha, words) {
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

// In the plots: area {left, right, lane} px, x: time -> px. Impacts, verdicts and notes have their words in the lane on top.
export function drawBands(canvas, { document, marks }, x, area, panes) {
  const on = pen(canvas);
  if (!on || !document) return;
  const { context } = on;
  for (const { top, bottom } of panes) drawModes(context, modesOf(document), x, area.left, area.right, top, bottom - top, ALPHA, false);
  const inside = ({ t_s }) => x(t_s) >= area.left && x(t_s) <= area.right;
  const told = marks.filter((event) => (event.name !== "mode" || event.level !== "INFO") && inside(event));
  drawEvents(context, told, x, panes);
  if (told.length <= CROWD) labels(context, told, x, area);
}

// Impacts, verdicts and notes as lines, all else as dots; in a crowd as faint lines, one where several are at the same pixel.
function drawEvents(context, events, x, panes) {
  const crowded = events.length > CROWD;
  for (const alike of Map.groupBy(events, (event) => `${eventColour(event)} ${isTold(event)}`).values()) {
    context.fillStyle = eventColour(alike[0]);
    context.globalAlpha = isTold(alike[0]) ? (crowded ? 0.25 : 0.75) : crowded ? 0.1 : 0.75;
    const dotted = !isTold(alike[0]) && !crowded;
    for (const place of new Set(alike.map(({ t_s }) => Math.round(x(t_s))))) {
      for (const { top, bottom } of panes) {
        for (let y = top; y < bottom; y += dotted ? 6 : bottom - top) context.fillRect(place, y, 1, dotted ? 2 : bottom - top);
      }
    }
  }
  context.globalAlpha = 1;
}

// Impacts, verdicts and notes in words, where there is room for them.
function labels(context, events, x, area) {
  context.font = `11px ${theme().font}`;
  context.textBaseline = "middle";
  let free = area.left;
  for (const event of events.filter(isTold)) {
    const place = x(event.t_s);
    const text = event.name === "impact" ? `impact${/\bleft\b/.test(event.text) ? " left" : /\bright\b/.test(event.text) ? " right" : ""}` : event.text.length > MOST_LETTERS ? `${event.text.slice(0, MOST_LETTERS - 3)}...` : event.text;
    const width = context.measureText(text).width + 9;
    const start = Math.min(place, area.right - width);
    if (start < free) continue;
    context.fillStyle = eventColour(event);
    context.beginPath(); // a flag: its foot is where it happened
    context.moveTo(place - 3, area.lane - 6);
    context.lineTo(place + 3, area.lane - 6);
    context.lineTo(place, area.lane);
    context.fill();
    context.fillText(text, start + 6, area.lane - 8);
    free = start + width + 4;
  }
}

// The whole log on one line, with what the plots show framed.
export function drawOverview(canvas, { document, marks }, view) {
  const on = pen(canvas);
  if (!on) return;
  const { context, width, height } = on;
  const x = (t) => (t / view.end) * width;
  context.font = `11px ${theme().font}`;
  context.textBaseline = "middle";
  context.fillStyle = theme().line;
  context.fillRect(0, 0, width, height);
  if (document) {
    context.fillStyle = theme().surface;
    context.fillRect(0, 0, x(document.share * view.end), height);
    drawModes(context, modesOf(document), x, 0, width, 0, height, 0.5, true);
    let last = -2;
    for (const event of marks) {
      const [note, place] = [event.name === "note", Math.round(x(event.t_s))];
      if ((event.name === "mode" && event.level === "INFO") || (place - last < 2 && !note)) continue;
      last = place;
      context.fillStyle = eventColour(event);
      context.fillRect(place - (note ? 1 : 0), 0, note ? 3 : 1, height);
      if (note) context.fillRect(place - 4, 0, 9, 5); // its head
    }
  }
  context.strokeStyle = theme().text;
  context.lineWidth = 1.5;
  context.strokeRect(x(view.from ?? 0) + 0.75, 0.75, Math.max(x((view.to ?? view.end) - (view.from ?? 0)) - 1.5, 2), height - 1.5);
}
