// Control of the robot: who has it, whether it may move, and the way out of a fault. The server decides, this asks.

import { post } from "./api.js";
import { TWO, UNCHANGED } from "./arms.js";
import { showError } from "./errors.js";
import { LOOKS } from "./scope.js";

const KEY = "rtstack.operator";
const ORDERS = ["take", "release", "arm", "disarm", "recover"];
const WHILE = { moving: "moving", recovering: "recovering" };

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
  if (other && (status.phase === "disarmed" || status.phase === "armed")) return `${status.holder} has control; take over first`;
  if (status.phase === "fault") return "there is a fault: recover first"; // the bar says which
  return status.refusal;
}

export class Control {
  constructor(live) {
    this.view = null;
    this.name = document.getElementById("operator");
    this.name.value = localStorage.getItem(KEY) ?? "";
    this.actions("take", "Control was not taken", () => {
      const order = { operator: this.name.value.trim() || null };
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
      return;
    }
    const { phase, holder } = status;
    const mine = holder === you;
    const from = holder !== null && !mine ? holder : "";
    const busy = WHILE[phase] ? `${TWO ? "the arms are" : "the arm is"} ${WHILE[phase]}` : null;

    this.name.disabled = mine;
    this.name.placeholder = you;
    button("take").dataset.from = from;
    write(button("take"), from ? "Take over" : "Take control");
    allow("take", LOOKS ? LOOKS : mine ? "You have control" : from && phase === "moving" ? `Take over once nothing moves: ${busy}` : null,
      from ? `Take over from ${from}: ${from} loses control, and the cell is disarmed` : "While you have it no other operator can start a motion");
    allow("release", mine ? null : "You do not have control", "Give control back; the cell is disarmed, and what moves stops");
    allow("arm", !mine ? "Take control first" : phase === "armed" ? "Armed" : busy, "Allow motion until you disarm, release or press STOP");
    allow("disarm", phase === "armed" || phase === "moving" ? null : "The cell is not armed", "Allow no motion; what moves stops");

    // in a fault nothing can be armed: the way out of it stands there instead
    const fault = phase === "fault" || phase === "recovering";
    button("arm").hidden = fault;
    button("recover").hidden = !fault;
    const active = status.job && ["starting", "running", "stopping"].includes(status.job.state);
    allow("recover", LOOKS ? LOOKS : active ? "Wait until the job has ended" : phase === "recovering" ? `${TWO ? "The arms are" : "The arm is"} recovering` : null,
      `Clear what ${TWO ? "the arms have" : "the arm has"} latched, once its cause is gone`);

    const next = fault ? "recover" : mine ? (phase === "disarmed" ? "arm" : "") : "take";
    for (const id of ORDERS) button(id).classList.toggle("next", id === next);
  }
}
