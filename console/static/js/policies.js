// The policies that are connected: the operator lets one of them lead, and takes its lease back.

import { post } from "./api.js";
import { whyNot } from "./control.js";
import { showError } from "./errors.js";

const $ = (id) => document.getElementById(id);

export class Policies {
  constructor(live) {
    this.leads = null;
    $("lend").addEventListener("click", () => this.lend());
    live.onView((view) => this.show(view));
  }

  async lend() {
    try {
      await post("/api/policy/lease", { to: this.leads ? null : $("policy").value });
    } catch (error) {
      showError(`Not done: ${error.message}.`);
    }
  }

  show({ hand, status, you, ...view }) {
    this.leads = hand.policy;
    const names = hand.policies;
    const none = names.length === 0 && !hand.policy;
    if ($("policies").hidden && !none) $("settings").open = true; // it has just connected
    $("policies").hidden = none;
    if ([...$("policy").options].map((each) => each.value).join() !== names.join()) {
      const chosen = $("policy").value;
      $("policy").replaceChildren(...names.map((name) => new Option(name, name, false, name === chosen)));
    }
    const job = status?.job;
    const runs = job?.kind === "teleoperation" && job.state === "running";
    const why = runs ? (status.holder === you ? null : "Another operator moves the cell") : whyNot({ ...view, status, you, hand }) ?? "Practise or record first";
    $("lend").disabled = why !== null;
    $("policy").disabled = hand.policy !== null;
    $("lend").textContent = hand.policy ? "Take back" : "Let it lead";
    $("policy-line").textContent = hand.policy ? `${hand.policy} leads. Hold to move takes over, STOP stops.` : why ?? "";
  }
}
