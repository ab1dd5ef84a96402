// What a demonstration is worth as a reference, in words.

import { get } from "./api.js";

const POLL_MS = 500;

export const remarkText = ({ text, good, advice }) => `${text}: ${good || !advice ? "good" : advice}`;

// The id of the log that a job has written.
export async function logOf(job) {
  const row = (await get("/api/logs")).find(({ name }) => name === job.log);
  if (!row) throw new Error(`${job.log} is not in the list of logs`);
  return row.id;
}

// One sentence: what was bad first.
export async function worthOf(job) {
  const id = await logOf(job);
  let extraction = null;
  while (extraction === null) {
    ({ extraction } = await get(`/api/recordings/${id}?wait=false`));
    if (extraction === null) await new Promise((resolve) => setTimeout(resolve, POLL_MS));
  }
  if (extraction.problem) return `No reference: ${extraction.problem}.`;
  const remarks = [...extraction.remarks].sort((a, b) => Number(a.good) - Number(b.good));
  return `As a reference: ${remarks.map(remarkText).join("; ")}.`;
}

// Says so once a recording is finished. live: the live state; say: takes the sentence.
export function tellWorth(live, say) {
  let told = null;
  live.onView(async ({ status }) => {
    const job = status?.job;
    if (job?.kind !== "teleoperation" || !job.recorded) return;
    if (job.state === "running") told ??= job.number;
    if (job.state !== "done" || told !== job.number) return;
    told = null;
    try {
      say(await worthOf(job), job);
    } catch (error) {
      say(`Its worth as a reference is not known: ${error.message}.`, job);
    }
  });
}
