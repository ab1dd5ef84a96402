// The top bar: lights, mode, loop health, age. Colour never says anything that a word does not say too.

import { wordOf } from "./modes.js";

const AMBER_S = 0.1;
const RED_S = 0.5;
const NEVER_S = 1e5;
const REFRESH_MS = 50;
const TEXT_EVERY = 5; // refreshes: a number that changes 20 times a second cannot be read
const SIDES = ["left", "right"];
const ROBOT_WORDS = {
  OTHER: "other", IDLE: "idle", MOVE: "moving", GUIDING: "guiding", REFLEX: "reflex",
  USER_STOPPED: "user stop", AUTOMATIC_ERROR_RECOVERY: "recovering", UNKNOWN: "no state",
};

export function ageText(age) {
  if (age > NEVER_S) return "none yet";
  if (age < 10) return `${Math.round(age * 1000)} ms`;
  return `${Math.round(age)} s`;
}

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

function showArm(side, arm) {
  const figure = document.getElementById(`light-${side}`);
  const fault = arm.errors.length > 0 || arm.robot_mode === "REFLEX";
  const moving = arm.robot_mode === "MOVE";
  figure.dataset.mode = fault ? "FAULT" : moving ? arm.mode : arm.robot_mode === "IDLE" ? "IDLE" : "UNKNOWN";
  write(figure.querySelector(".word"), fault ? "fault" : moving ? wordOf(arm.mode) : ROBOT_WORDS[arm.robot_mode] ?? arm.robot_mode);
  const errors = arm.errors.length ? `: ${arm.errors.join(", ")}` : "";
  figure.title = `The robot says ${arm.robot_mode}${errors}; commands received ${Math.round(arm.success_rate * 100)} %`;
}

function showLoop({ loop, status }) {
  const element = document.getElementById("loop");
  const caption = element.parentElement.querySelector(".caption");
  write(caption, status?.scheduler === "fifo" ? "loop fifo, mean/p99/missed" : "loop, mean / p99 / missed"); // hardly wider
  if (loop.period_us === null) return write(element, "-");
  const ms = (us) => (us / 1000).toFixed(2);
  write(element, `${ms(loop.period_us)} / ${ms(loop.period_p99_us)} ms / ${loop.missed}`);
}

function showHolder({ status, you }) {
  const figure = document.getElementById("control-light");
  const phase = status?.phase ?? "unknown";
  figure.dataset.phase = phase;
  write(figure.querySelector(".word"), phase === "unknown" ? "waiting" : phase);
  const holder = status?.holder ?? null;
  write(document.getElementById("holder"), holder === null ? "no operator has control" : holder === you ? `you, ${holder}` : holder);
}

export function startBar(live) {
  const mode = document.getElementById("mode");
  live.onView((view) => {
    for (const side of SIDES) showArm(side, view[side]);
    mode.dataset.mode = view.left.mode;
    write(mode.querySelector(".word"), wordOf(view.left.mode));
    showLoop(view);
    showHolder(view);
  });

  const age = document.getElementById("age");
  const veil = document.getElementById("veil");
  let refreshes = 0;
  let worst = 0;
  let shown = 0;
  setInterval(() => {
    const oldest = Math.max(...SIDES.map((side) => live.ageOf(side)));
    worst = Math.max(worst, oldest);
    if (refreshes % TEXT_EVERY === 0) {
      shown = worst;
      worst = 0;
      write(age.querySelector(".value"), ageText(shown));
    }
    refreshes += 1;
    const colour = Math.max(oldest, shown);
    age.dataset.age = colour >= RED_S ? "red" : colour >= AMBER_S ? "amber" : "fresh";
    const stale = oldest >= RED_S;
    document.body.classList.toggle("stale", stale);
    if (!veil) return; // a page without a live scene: the age says it
    veil.hidden = !stale;
    const source = live.since() >= RED_S ? "No word from the console" : "No new state from the robot";
    write(veil, oldest > NEVER_S ? `${source} yet` : `${source} for ${ageText(oldest)}: what you see is old`);
  }, REFRESH_MS);
}
