// A log on the arms themselves: asks once, says why it cannot, shows how far it is, and ends it softly.

import { post } from "./api.js";
import { whyNot } from "./control.js";
import { ask } from "./dialog.js";
import { showError } from "./errors.js";

const ACTIVE = ["starting", "running", "stopping"];
const $ = (id) => document.getElementById(id);

function sentence(job) {
  if (ACTIVE.includes(job.state)) return `Playback ${job.number} ${job.state === "running" ? "runs" : `is ${job.state}`}.`;
  if (job.state === "done" && job.success) return `Playback ${job.number} went to the log's end.`;
  return `Playback ${job.number} ended early: ${job.reason ?? "stopped"}.`;
}

// id: of the log; live: the live state, as frame.js gives it.
export function startPlayback(id, live) {
  const say = (text) => {
    if ($("arms-line").textContent !== text) $("arms-line").textContent = text;
  };

  $("arms-play").addEventListener("click", async () => {
    const speed = parseFloat($("arms-speed").value);
    const where = document.querySelector(".badge.real") ? "the REAL arms" : "the simulated arms";
    const question = `Play this log on ${where} at ${speed}x?`;
    const details = "Both arms go to where the log begins, then along its path. Nothing may be in their way: take the object out of the cell.";
    if (!(await ask({ question, details, yes: "Play" }))) return;
    $("arms-play").disabled = true;
    try {
      await post("/api/jobs/playback", { log: id, speed });
    } catch (error) {
      showError(`Not played: ${error.message}. Both arms stay as they are.`);
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
    const why = whyNot(view);
    $("arms-play").disabled = why !== null;
    $("arms-play").title = why ?? "Play this log on both arms, with a soft start and a soft stop";
    const job = view.status?.job?.kind === "playback" ? view.status.job : null;
    const runs = job?.state === "running" && view.status.holder === view.you;
    $("arms-end").disabled = !runs;
    $("arms-end").title = runs ? "Brake along the path, within half a second; STOP is quicker" : "No playback of yours runs";
    $("arms-progress").hidden = job === null || !ACTIVE.includes(job.state);
    $("arms-progress").value = job?.progress ?? 0;
    say(job === null ? why ?? "" : sentence(job));
  });
}
