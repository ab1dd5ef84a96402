// The time line below curves and scene: the slider moves the cursor, the cursor moves the slider; play and pause.

import { drawOverview } from "./bands.js";

const SAMPLE_S = 0.001;

export class Timeline {
  constructor(view, log, marks) {
    Object.assign(this, { view, log, marks });
    this.slider = document.getElementById("slider");
    this.canvas = document.getElementById("overview");
    this.button = document.getElementById("play");
    this.speed = document.getElementById("speed");
    this.playing = false;
    this.slider.addEventListener("input", () => view.setCursor(this.slider.valueAsNumber));
    this.button.addEventListener("click", () => this.play(!this.playing));
    view.on("cursor", () => this.showCursor());
    for (const what of ["window", "other"]) view.on(what, () => this.draw());
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    new MutationObserver(() => this.draw()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  }

  draw() {
    this.slider.disabled = !this.view.known; // it would go back to the beginning once the length is known
    this.slider.max = this.view.end;
    drawOverview(this.canvas, this.log, this.view);
  }

  showCursor() {
    const text = `${this.view.t.toFixed(3)} s`;
    this.slider.max = this.view.end;
    this.slider.value = this.view.t;
    this.slider.setAttribute("aria-valuetext", text);
    document.getElementById("now").textContent = text;
  }

  play(on) {
    this.playing = on;
    this.button.textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (this.view.t >= this.view.end) this.view.setCursor(0);
    let last = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      const t = this.view.t + ((now - last) / 1000) * parseFloat(this.speed.value);
      last = now;
      this.view.setCursor(t);
      this.follow();
      if (t >= this.view.end) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  // Turn the page of curves when the cursor leaves it.
  follow() {
    const { t, from, to } = this.view;
    if (t > to || t < from) this.view.setWindow(t, t + (to - from));
  }

  step(samples) {
    this.play(false);
    this.view.setCursor(Math.round((this.view.t + samples * SAMPLE_S) / SAMPLE_S) * SAMPLE_S);
    this.follow();
  }
}
