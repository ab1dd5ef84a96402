// A picture of what the curves show: bands, curves, names and values, and where it comes from.

import { save } from "./saving.js";
import { theme } from "./style.js";

const SCALE = 2;
const HEAD_PX = 28;
const [LEFT_PX, LINE_PX] = [64, 20]; // of a legend

// compared: what is said about the other log, where there is one
export async function savePicture(plots, name, compared) {
  const { text, surface, font } = theme();
  const [width, height] = [plots.area.clientWidth, plots.area.clientHeight];
  if (plots.drawn === null) throw new Error("no curves have come yet");
  if (!width) throw new Error("there are no curves; tick a signal first");
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width * SCALE, (height + HEAD_PX) * SCALE];
  const context = canvas.getContext("2d");
  context.scale(SCALE, SCALE);
  context.fillStyle = surface;
  context.fillRect(0, 0, width, height + HEAD_PX);
  context.fillStyle = text;
  context.textBaseline = "middle";
  context.font = `600 13px ${font}`;
  const { from, to, t } = plots.view;
  context.fillText(`${name}   ${from.toFixed(3)} to ${to.toFixed(3)} s, cursor ${t.toFixed(3)} s${compared ? `;   ${compared}` : ""}`, 12, HEAD_PX / 2, width - 24);
  context.translate(0, HEAD_PX);
  context.drawImage(document.getElementById("bands"), 0, 0, width, height);
  plots.chart.draw(context);
  const cursor = plots.chart.x(t);
  if (!plots.cursor.hidden) {
    context.fillStyle = text;
    context.fillRect(Math.round(cursor), 0, 1, plots.panes.at(-1)?.bottom ?? 0);
  }
  context.font = `12px ${font}`;
  for (const { members, legend } of plots.panes) {
    let [x, y] = [LEFT_PX, legend + LINE_PX / 2];
    const write = (words, colour) => {
      const { width: long } = context.measureText(words);
      if (x > LEFT_PX && x + long > width) [x, y] = [LEFT_PX, y + LINE_PX];
      context.fillStyle = colour;
      context.fillText(words, x, y);
      x += long + 16;
    };
    write(members[0].unit ? `${members[0].field}, ${members[0].unit}` : members[0].field, text);
    for (const signal of members) write(`— ${signal.group} ${signal.component}`, plots.colour(signal));
  }
  const blob = await new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  save(blob, `${name.replace(/\.mcap$/, "")}.png`);
}
