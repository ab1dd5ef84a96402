// The pictures of the log's cameras at the cursor: one request at a time for each camera, always for the newest cursor.

import { get } from "../api.js";

const NEAR_S = 1e-6;

export class Cameras {
  constructor(view, log) {
    Object.assign(this, { view, log, shown: [] });
    this.section = document.getElementById("cameras");
  }

  async start() {
    const { cameras: times } = await get(`/api/logs/${this.log.id}/cameras`);
    for (const [name, at] of Object.entries(times)) this.add(name, at);
    this.section.hidden = this.shown.length === 0;
    this.view.on("cursor", () => this.show());
    this.show();
  }

  add(name, times) {
    const figure = document.createElement("figure");
    const image = Object.assign(document.createElement("img"), { alt: `Camera ${name} at the cursor` });
    const caption = document.createElement("figcaption");
    figure.append(image, caption);
    this.section.append(figure);
    const camera = { name, times, image, caption, at: null, busy: false };
    for (const end of ["load", "error"]) {
      image.addEventListener(end, () => {
        camera.busy = false;
        this.ask(camera);
      });
    }
    this.shown.push(camera);
  }

  // Index of the newest picture at the cursor, or of the first one.
  index(times) {
    let [low, high] = [0, times.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= this.view.t + NEAR_S) low = middle + 1;
      else high = middle;
    }
    return Math.max(0, low - 1);
  }

  show() {
    for (const camera of this.shown) this.ask(camera);
  }

  ask(camera) {
    const at = this.index(camera.times);
    if (camera.busy || at === camera.at) return;
    camera.at = at;
    camera.busy = true;
    const t = camera.times[at];
    camera.caption.textContent = `${camera.name}: picture ${at + 1} of ${camera.times.length}, ${t.toFixed(3)} s`;
    camera.image.dataset.t = t;
    camera.image.src = `/api/logs/${this.log.id}/cameras/${camera.name}?t=${t + NEAR_S}`;
  }

  // One picture on, or back, of the first camera.
  step(pictures) {
    const [camera] = this.shown;
    if (!camera) return;
    const to = Math.min(Math.max(this.index(camera.times) + pictures, 0), camera.times.length - 1);
    this.view.setCursor(camera.times[to]);
  }
}
