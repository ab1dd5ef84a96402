// Control of the robot: who has it, whether it may move, and the way out of a fault. The server decides, this asks.

import { post } from "./api.js";
import { REAL, TWO, UNCHANGED } from "./arms.js";
import { showError } from "./errors.js";
import { moveFocus } from "./keyboard.js";
import { LOOKS } from "./scope.js";

const KEY = "rtstack.operator";
const ORDERS = ["take", "release", "arm", "disarm", "recover"];
const PLACES = ["take", "arm", "recover", "disarm"]; // they share one place
const ACTIVE = new Set(["starting", "running", "stopping"]);
const WHILE = { moving: "moving", recovering: "recovering" };

const sentence = (text) => `${text[0].toUpperCase()}${text.slice(1).replace(/\.$/, "")}.`;

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

const button = (id) => document.getElementById(id);

function allow(id, why, what) {
  button(id).disabled = why !== null;
  button(id).title = why ?? what;
}

// Why this page cannot start anything, in a line; null where it can.
export function whyNot(view) {
  const { status, you, unreachable } = view;
  if (LOOKS) return LOOKS;
  if (unreachable) return unreachable;
  if (status === null) return "the robot process has not answered yet";
  const other = status.holder !== null && status.holder !== you;
  if (other && (status.phase === "disarmed" || status.phase === "armed")) return `${status.holder} has control: ask for control first`;
  if (status.phase === "fault") return "there is a fault: recover first"; // the bar says which
  return status.refusal;
}

// What both pads hold is put down before the next run; the button for that is on the page Operate.
const holds = ({ state, status }) => state.held_n !== null && !(status?.job && ACTIVE.has(status.job.state));
const there = () => (document.getElementById("moves") ? "" : " on the page Operate");

// Why no trial and no demonstration can begin, in a line; null where it can.
export const whyNoRun = (view) => whyNot(view) ?? (holds(view) ? `the arms hold an object: press Put it down${there()} first` : null);

// The next step, in a sentence.
function step(view) {
  const { status, you, unreachable, request, state } = view;
  if (LOOKS) return `${LOOKS}.`;
  if (unreachable) return sentence(unreachable);
  const { phase, holder, job } = status;
  if (phase === "fault") return "Press Recover once the cause is gone.";
  if (phase === "recovering") return `${TWO ? "The arms clear their errors" : "The arm clears its errors"}.`;
  if (holder === null) return `Take control to move ${TWO ? "the arms" : "the arm"}.`;
  if (holder !== you) {
    if (request?.operator !== you) return `${holder} has control.`;
    return request.kept ? `${holder} keeps control.` : request.silent ? `${holder} does not answer.` : `Wait: ${holder} was asked for control.`;
  }
  if (phase === "disarmed") return "Arm to allow motion.";
  if (job && ACTIVE.has(job.state)) {
    if (job.state === "starting" || (!REAL && state.word === "preparing")) return "Wait: nothing moves yet.";
    if (job.state === "stopping") return "Wait: it is being stopped.";
    return job.kind === "teleoperation" ? "Move by hand, then press Finish." : "Wait until it ends, or cancel it.";
  }
  if (status.refusal) return sentence(status.refusal); // such as compiling, at the first use
  if (holds(view)) return `Both arms hold an object. Press Put it down${there()} before the next run.`;
  const undecided = document.querySelector("#episode-outcome:not([hidden])");
  if (undecided && !undecided.querySelector("[aria-pressed=true]")) return "Say what became of it.";
  if (document.getElementById("follow")?.checkVisibility()) return "Run a trial with it, or record again.";
  const act = [...document.querySelectorAll("main .act")].find((each) => each.checkVisibility());
  return act && !act.disabled ? `Press ${act.textContent.trim()} below.` : "Choose below what to do.";
}

export class Control {
  constructor(live) {
    this.view = null;
    this.pressed = null; // the button of the place that was pressed by a key: it is disabled, which takes the focus away
    window.addEventListener("pointerdown", () => (this.pressed = null), true);
    this.name = document.getElementById("operator");
    this.name.value = localStorage.getItem(KEY) ?? "";
    this.actions("take", "Control was not taken", () => {
      const order = { operator: this.name.value.trim() || null };
      if (button("take").dataset.asks) return post("/api/request", order);
      if (button("take").dataset.from) order.over_from = button("take").dataset.from;
      if (order.operator) localStorage.setItem(KEY, order.operator);
      return post("/api/take", order);
    });
    this.actions("release", "Control was not released", () => post("/api/release"));
    this.actions("arm", "Not armed", () => post("/api/arm"));
    this.actions("disarm", "Not disarmed", () => post("/api/disarm"));
    this.actions("recover", "Recovery refused", () => post("/api/recover"));
    live.onView((view) => this.show(view));
  }

  actions(id, failure, act) {
    button(id).addEventListener("click", async () => {
      if (PLACES.includes(id) && button(id).matches(":focus-visible")) this.pressed = id;
      button(id).disabled = true;
      try {
        await act();
      } catch (error) {
        showError(`${failure}: ${error.message}. ${UNCHANGED}`);
      } finally {
        if (this.view) this.show(this.view);
      }
    });
  }

  show(view) {
    this.view = view;
    const { status, you } = view;
    if (status === null || view.unreachable) {
      const why = view.unreachable ?? "the robot process has not answered yet";
      for (const id of ORDERS) allow(id, why, "");
      write(document.getElementById("step"), sentence(why));
      return;
    }
    const { phase, holder } = status;
    const mine = holder === you;
    const from = holder !== null && !mine ? holder : "";
    const busy = WHILE[phase] ? `${TWO ? "the arms are" : "the arm is"} ${WHILE[phase]}` : null;

    this.name.disabled = mine;
    this.name.placeholder = you;
    button("take").dataset.from = from;
    const asked = view.request?.operator === you ? view.request : null;
    const wait = asked && !asked.silent && !asked.kept;
    button("take").dataset.asks = from && !asked?.silent ? "yes" : "";
    write(button("take"), !from ? "Take control" : asked?.silent ? "Take over" : "Ask for control");
    allow("take", LOOKS ? LOOKS : mine ? "You have control" : wait ? `${from} has not answered yet` : from && phase === "moving" ? `Take over once nothing moves: ${busy}` : null,
      !from ? "While you have it no other operator can start a motion" : asked?.silent
        ? `${from} has not answered. Take over: ${from} loses control, and the cell is disarmed` : `${from} sees the question, and can hand control over`);
    allow("release", mine ? null : "You do not have control", "Give control back; the cell is disarmed, and what moves stops");
    allow("arm", !mine ? "Take control first" : phase === "armed" ? "Armed" : busy, "Allow motion until you disarm, release or press STOP");
    allow("disarm", phase === "armed" || phase === "moving" ? null : "The cell is not armed", "Allow no motion; what moves stops");

    const fault = phase === "fault" || phase === "recovering";
    const active = status.job && ACTIVE.has(status.job.state);
    allow("recover", LOOKS ? LOOKS : active ? "Wait until the job has ended" : phase === "recovering" ? `${TWO ? "The arms are" : "The arm is"} recovering` : null,
      `Clear what ${TWO ? "the arms have" : "the arm has"} latched, once its cause is gone`);
    this.place(fault ? "recover" : !mine ? "take" : phase === "disarmed" ? "arm" : "disarm", mine);
    write(document.getElementById("step"), step(view));
  }

  // One button at a time, all in one place; a name is typed before control is taken, and control is given back after it.
  place(next, mine) {
    const at = document.activeElement;
    const here = (PLACES.includes(at.id) && at.matches(":focus-visible")) || (this.pressed !== null && at === document.body);
    for (const id of PLACES) {
      button(id).dataset.away = String(id !== next);
      button(id).classList.toggle("next", id === next && id !== "disarm");
    }
    button("release").dataset.away = String(!mine);
    this.name.parentElement.dataset.away = String(mine);
    if (!here) this.pressed = null;
    else if (at !== button(next) && !button(next).disabled) moveFocus(button(next));
    if (this.pressed !== next && document.activeElement === button(next)) this.pressed = null;
  }
}
