// A worker: signs of life for a page whose main thread is busy, as it may be for seconds where the processor draws the
// scene. They end with the page, and once it has shown no view for BUSY_MS.

const PERIOD_MS = 500; // the robot process allows 2 s: LEASE_S in rtstack/safety/arming.py
const BUSY_MS = 5000;

let shownMs = -Infinity;
let csrf = "";

self.addEventListener("message", ({ data }) => {
  shownMs = performance.now();
  csrf = data;
});

setInterval(() => {
  if (performance.now() - shownMs > BUSY_MS) return;
  fetch("/api/beat", { method: "POST", headers: { "x-csrf-token": csrf } }).catch(() => {}); // the page says it itself
}, PERIOD_MS);
