// The top bar: the cell's state in one word and one colour, what to do next, lights, loop health, age. Colour never says
// anything that a word does not say too.

import { ALL_ARMS, SIDES, TWO } from "./arms.js";
import { faultSentence, remedySentence } from "./faults.js";
import { WHAT } from "./job_line.js";
import { wordOf } from "./modes.js";
import { LOOKS } from "./scope.js";

const AMBER_S = 0.1;
const RED_S = 0.5;
const NEVER_S = 1e5;
const PREPARED_S = 15; // a preparation without any state for longer is an alarm, too
const OPENING_MS = 10000; // a page that was just opened has nothing old to warn of
const REFRESH_MS = 50;
const TEXT_EVERY = 5; // refreshes: a number that changes 20 times a second cannot be read
const ROBOT_WORDS = {
  OTHER: "other", IDLE: "idle", MOVE: "moving", GUIDING: "guiding", REFLEX: "reflex",
  USER_STOPPED: "user stop", AUTOMATIC_ERROR_RECOVERY: "recovering", UNKNOWN: "no state",
};

export function ageText(age) {
  if (age > NEVER_S) return "none yet";
  if (age < 10) return `${Math.round(age * 1000)} ms`;
  return `${Math.round(age)} s`;
}

const $ = (id) => document.getElementById(id);

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

const newtons = (held) => `${held.toFixed(0)} N`;

function showArm(side, arm, held) {
  const figure = $(`light-${side}`);
  const fault = arm.errors.length > 0 || arm.robot_mode === "REFLEX";
  const moving = arm.robot_mode === "MOVE";
  const idle = arm.robot_mode === "IDLE";
  const holds = idle && held !== null;
  figure.dataset.mode = fault ? "FAULT" : moving ? arm.mode : holds ? "HOLDING" : idle ? "IDLE" : "UNKNOWN";
  const word = moving ? wordOf(arm.mode) : holds ? `holds ${newtons(held)}` : ROBOT_WORDS[arm.robot_mode] ?? arm.robot_mode;
  write(figure.querySelector(".word"), fault ? "fault" : word);
  const errors = arm.errors.length ? `: ${arm.errors.join(", ")}` : "";
  figure.title = `The robot reports ${arm.robot_mode}${errors}; commands received ${Math.round(arm.success_rate * 100)} %`;
}

function showLoop({ loop, status }) {
  const element = $("loop");
  const caption = element.parentElement.querySelector(".caption");
  write(caption, status?.scheduler === "fifo" ? "loop fifo, mean/p99/missed" : "loop, mean / p99 / missed"); // hardly wider
  const ms = (us) => (us === null ? "-" : (us / 1000).toFixed(2));
  const part = (name, text, keeping, meaning) => {
    const place = element.querySelector(`[data-part=${name}]`);
    write(place, text);
    place.dataset.keeping = keeping;
    place.title = meaning;
  };
  part("mean", ms(loop.period_us), "good", "Mean time between ticks, ms");
  part("p99", ms(loop.period_p99_us), loop.lateness, loop.lateness === "good" ? "99th percentile, ms"
    : "More than 0.3 ms late, which is all that a robot leaves for an answer: end what else this machine computes");
  part("missed", String(loop.missed), loop.losses, loop.losses === "good" ? "None missed within the last 2 s"
    : "Ticks were missed within the last 2 s; a robot gives up after 20 in a row: see rtstack check");
}

const job = ({ status }) => `${WHAT[status.job.kind]} ${status.job.number}`;

// What is so and what to do next, in a sentence.
function sentence(view) {
  const { status, you, state } = view;
  if (view.unreachable !== null) return view.unreachable;
  if (status === null) return "The robot process has not answered yet.";
  const { holder, phase } = status;
  const mine = holder === you;
  const runs = status.job && ["starting", "running", "stopping"].includes(status.job.state);
  switch (state.word) {
    case "fault": return faultSentence(status.reason ?? "", state.remedy !== null);
    case "recovering": return TWO ? "The arms clear their errors." : "The arm clears its errors.";
    case "preparing": return runs ? `${job(view)} is being prepared: nothing moves yet.` : "A motion is being prepared: nothing moves yet.";
    case "moving": return runs ? `${job(view)} moves ${TWO ? "the arms" : "the arm"}.` : `${TWO ? "An arm" : "The arm"} moves, and no job moves it.`;
    case "holding":
      if (runs) return `${job(view)} holds ${ALL_ARMS} still; ${TWO ? "they" : "it"} may move at any moment.`;
      return `Both arms hold what is between them. ${mine ? "Arm to go on." : holder === null ? "Take control, then arm, to go on." : ""}`;
    case "armed": return mine ? "You can start a motion." : `${holder} can start a motion.`;
    default:
      if (phase === "moving") return "";
      if (LOOKS) return holder === null ? "No operator has control." : `${holder} has control.`;
      if (holder === null) return "Take control, then arm.";
      return mine ? "You have control. Arm to start." : `${holder} has control.`;
  }
}

function showState(view) {
  const { status, state, you } = view;
  const band = $("control-light");
  band.dataset.phase = (view.unreachable === null && status?.phase) || "unknown";
  band.dataset.state = state.word;
  write(band.querySelector(".word"), state.word);
  const held = $("held");
  held.hidden = state.held_n === null;
  if (state.held_n !== null) write(held, `${state.word === "holding" ? "" : "holding "}${newtons(state.held_n)}`);
  const text = sentence(view);
  write($("control-line"), text);
  $("control-line").title = text;
  const remedy = $("remedy");
  remedy.hidden = state.remedy === null;
  if (state.remedy !== null) {
    const { todo, anchor } = state.remedy;
    write(remedy.querySelector("span"), remedySentence(todo));
    remedy.title = remedy.querySelector("span").textContent;
    remedy.querySelector("a").href = `/recovery#${anchor}`;
  }
  const holder = status?.holder ?? null;
  $("holder").title = `Who has control: ${holder ?? "no operator"}`;
  write($("holder"), holder === null ? "no operator has control" : holder === you ? `you, ${holder}` : holder);
}

export function startBar(live) {
  live.onView((view) => {
    for (const side of SIDES) showArm(side, view[side], view.state.held_n);
    showLoop(view);
    showState(view);
  });

  const age = $("age");
  const veil = $("veil");
  let refreshes = 0;
  let worst = 0;
  let shown = 0;
  setInterval(() => {
    if (live.receivedMs === null && performance.now() < OPENING_MS) return;
    const oldest = Math.max(...SIDES.map((side) => live.ageOf(side)));
    worst = Math.max(worst, oldest);
    // a cell that is opened anew says nothing meanwhile, and nothing moves: no alarm
    const preparing = live.since() < RED_S && live.view?.state.word === "preparing" && oldest < PREPARED_S;
    if (refreshes % TEXT_EVERY === 0) {
      shown = worst;
      worst = 0;
      write(age.querySelector(".value"), preparing && shown >= RED_S ? "soon" : ageText(shown));
    }
    refreshes += 1;
    const colour = Math.max(oldest, shown);
    age.dataset.age = preparing ? "fresh" : colour >= RED_S ? "red" : colour >= AMBER_S ? "amber" : "fresh";
    const stale = oldest >= RED_S && !preparing;
    document.body.classList.toggle("stale", stale);
    if (!veil) return; // a page without a live scene: the age says it
    veil.hidden = !stale;
    const source = live.since() >= RED_S ? "No word from the console" : "No new state from the robot";
    write(veil, oldest > NEVER_S ? `${source} yet` : `${source} for ${ageText(oldest)}: what you see is old`);
  }, REFRESH_MS);
}
