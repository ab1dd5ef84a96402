// A log on the arms themselves: says how fast it may be played, asks once, shows how far it is, and ends it softly.

import { get, post } from "./api.js";
import { ALL_ARMS, TWO, UNCHANGED } from "./arms.js";
import { whyNot } from "./control.js";
import { ask } from "./dialog.js";
import { showError } from "./errors.js";

const ACTIVE = ["starting", "running", "stopping"];
const ASK_MS = 1000;
const $ = (id) => document.getElementById(id);

function sentence(job) {
  if (ACTIVE.includes(job.state)) return `Playback ${job.number} ${job.state === "running" ? "runs" : `is ${job.state}`}.`;
  if (job.state === "done" && job.success) return `Playback ${job.number} went to the log's end.`;
  return `Playback ${job.number} ended early: ${job.reason ?? "stopped"}.`;
}

// Asks how fast a log may be played, once there is a reason to, and offers no more than that.
class Limit {
  constructor(id) {
    this.id = id;
    this.asked = false;
    this.said = "";
    this.refused = null;
    this.known = false;
  }

  async ask() {
    if (this.asked) return;
    this.asked = true;
    this.said = "How fast it may be played is being computed.";
    try {
      for (;;) {
        const { fastest, refused } = await get(`/api/logs/${this.id}/playback`);
        if (fastest !== null || refused !== null) return this.offer(fastest, refused);
        await new Promise((resolve) => setTimeout(resolve, ASK_MS));
      }
    } catch (error) {
      this.said = `How fast it may be played is not known: ${error.message}`;
      this.known = true; // the robot process looks at it again
    }
  }

  offer(fastest, refused) {
    this.known = true;
    this.refused = refused;
    this.said = refused === null ? `At most ${fastest}x: faster is beyond ${TWO ? "the arms'" : "the arm's"} limits.` : `It cannot be played: ${refused}`;
    if (fastest === null) return;
    const select = $("arms-speed");
    const chosen = parseFloat(select.value);
    const slower = [...select.options].map(({ value }) => parseFloat(value)).filter((speed) => speed < fastest);
    select.replaceChildren(...[...slower, fastest].map((speed) => new Option(`${speed}x`, speed)));
    select.value = chosen <= fastest ? chosen : fastest;
    if (select.selectedIndex < 0) select.value = fastest;
  }
}

// id: of the log; live: the live state, as frame.js gives it.
export function startPlayback(id, live) {
  const { name } = document.querySelector("main").dataset;
  const limit = new Limit(id);
  const panel = document.querySelector(".arms");
  for (const kind of ["pointerenter", "focusin"]) panel.addEventListener(kind, () => limit.ask());
  const say = (text) => {
    if ($("arms-line").textContent !== text) $("arms-line").textContent = text;
  };

  $("arms-play").addEventListener("click", async () => {
    const speed = parseFloat($("arms-speed").value);
    const where = `the ${document.querySelector(".badge.real") ? "REAL" : "simulated"} ${TWO ? "arms" : "arm"}`;
    const question = `Play this log on ${where} at ${speed}x?`;
    const go = TWO ? "Both arms go to where the log begins, then along its path. Nothing may be in their way" : "The arm goes to where the log begins, then along its path. Nothing may be in its way";
    const details = `${go}: take the object out of the cell.`;
    if (!(await ask({ question, details, yes: "Play" }))) return;
    $("arms-play").disabled = true;
    try {
      await post("/api/jobs/playback", { log: id, speed });
    } catch (error) {
      showError(`Not played: ${error.message}. ${UNCHANGED}`);
    }
  });

  $("arms-end").addEventListener("click", async () => {
    try {
      await post("/api/playback/finish");
    } catch (error) {
      showError(`Not ended softly: ${error.message}. STOP always works.`);
    }
  });

  live.onView((view) => {
    if (whyNot(view) === null) limit.ask();
    const why = whyNot(view) ?? limit.refused ?? (limit.known ? null : limit.said || "how fast it may be played is not known yet");
    $("arms-play").disabled = why !== null;
    $("arms-play").title = why ?? `Play this log on ${ALL_ARMS}, with a soft start and a soft stop`;
    const last = view.status?.job;
    const job = last?.kind === "playback" && last.title.startsWith(`${name} at `) ? last : null;
    const runs = job?.state === "running" && view.status.holder === view.you;
    $("arms-end").disabled = !runs;
    $("arms-end").title = runs ? "Brake along the path, within half a second; STOP is quicker" : "No playback of yours runs";
    $("arms-progress").hidden = job === null || !ACTIVE.includes(job.state);
    $("arms-progress").value = job?.progress ?? 0;
    say(job === null ? limit.said || (why ?? "") : sentence(job));
  });
}
