// One log on the server: what is known of it, how far it has been read, its curves.

import { get, Refused } from "../api.js";

const POLL_MS = 300;
const FIRST_POLL_MS = 50; // until there is something to see

export class Log {
  constructor(id) {
    this.id = id;
    this.document = null;
    this.notes = []; // what people wrote at times of it, [{t_s, text}]
  }

  // Ask until all of it has been read; `onPart` is told of every part.
  async read(onPart) {
    for (;;) {
      const document = await get(`/api/logs/${this.id}`);
      const grown = this.document === null || document.share > this.document.share || document.done;
      this.document = document;
      if (grown && document.duration_s !== null) onPart(document);
      if (document.done) return;
      await new Promise((resolve) => setTimeout(resolve, document.share > 0 ? POLL_MS : FIRST_POLL_MS));
    }
  }

  // Whether an analysis gives this signal of this log.
  gives(name) {
    return this.document?.analyses.some(({ signals }) => signals.some((signal) => signal.name === name)) ?? false;
  }

  // Events and notes, in order of time.
  get marks() {
    const notes = this.notes.map((note) => ({ ...note, note, level: "NOTE", name: "note" }));
    return [...(this.document?.events ?? []), ...notes].sort((a, b) => a.t_s - b.t_s);
  }

  get impact() {
    return this.document?.events.find((event) => event.name === "impact")?.t_s ?? null;
  }

  // Curves in a window: [{name, bucket, t, low, high}], s after the first sample. less: {log, offset}, of which the
  // difference to this log is wanted.
  async curves(signals, from, to, width, less = null) {
    if (signals.length === 0) return [];
    const other = less === null ? {} : { other: less.log.id, offset: less.offset };
    const query = new URLSearchParams({ signals: signals.join(","), start: from, end: to, width, ...other });
    const answer = await fetch(`/api/logs/${this.id}/series?${query}`);
    if (!answer.ok) throw new Refused((await answer.json().catch(() => ({}))).error ?? `the console answered ${answer.status}`);
    return unpacked(await answer.arrayBuffer());
  }
}

const aligned = (bytes) => Math.ceil(bytes / 8) * 8;

// As console.review.series.packed writes it.
function unpacked(buffer) {
  const length = new Uint32Array(buffer, 0, 1)[0];
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const curves = [];
  let place = 4 + length;
  for (const { signals, bucket, points } of header) {
    const t = new Float64Array(buffer, place, points);
    place += 8 * points;
    const next = () => {
      const values = new Float32Array(buffer, place, points);
      place += aligned(4 * points);
      return values;
    };
    for (const name of signals) {
      const low = next();
      curves.push({ name, bucket, t, low, high: bucket > 1 ? next() : low });
    }
  }
  return curves;
}
