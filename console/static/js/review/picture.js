/* global Plotly */
// A picture of what the curves show: bands, curves, names and values, and where it comes from.

import { save } from "./saving.js";
import { theme } from "./style.js";

const SCALE = 2;
const HEAD_PX = 28;

export async function savePicture(plots, name) {
  const { text, surface, font } = theme();
  const [width, height] = [plots.area.clientWidth, plots.area.clientHeight];
  const curves = new Image();
  curves.src = await Plotly.toImage(plots.figure, { format: "png", width, height, scale: SCALE });
  await curves.decode();
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
  context.fillText(`${name}   ${from.toFixed(3)} to ${to.toFixed(3)} s, cursor ${t.toFixed(3)} s`, 12, HEAD_PX / 2);
  context.translate(0, HEAD_PX);
  context.drawImage(document.getElementById("bands"), 0, 0, width, height);
  context.drawImage(curves, 0, 0, width, height);
  context.font = `12px ${font}`;
  for (const { members, top } of plots.panes) {
    let x = 64;
    const write = (words, colour) => {
      context.fillStyle = colour;
      context.fillText(words, x, top - 10);
      x += context.measureText(words).width + 16;
    };
    write(members[0].unit ? `${members[0].field}, ${members[0].unit}` : members[0].field, text);
    for (const signal of members) write(`— ${signal.group} ${signal.component}`, plots.colour(signal));
  }
  const blob = await new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  save(blob, `${name.replace(/\.mcap$/, "")}.png`);
}
