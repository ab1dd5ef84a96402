// What people say about logs: a star at once, tags and a note in a dialog; of several logs, tags are added to each.

import { post } from "./api.js";
import { closeDialog, openDialog } from "./dialog.js";
import { showError } from "./errors.js";
import { LOOKS } from "./scope.js";

const $ = (id) => document.getElementById(id);

export const keep = (log, change) => post(`/api/logs/${log.id}/remarks`, { starred: log.starred, tags: log.tags, note: log.note ?? "", verdict: log.episode_verdict, ...change });

// A column of a table of logs: a star that is set and taken back by a click.
export function star(changed) {
  return (row, log) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "star";
    button.textContent = log.starred ? "\u2605" : "\u2606";
    button.setAttribute("aria-pressed", String(log.starred));
    button.setAttribute("aria-label", `Star ${log.name}`);
    button.title = LOOKS ?? (log.starred ? "Take the star back" : "Star it: it stays, whatever is pruned");
    button.disabled = LOOKS !== null;
    button.addEventListener("click", async () => {
      try {
        await keep(log, { starred: !log.starred });
        changed();
      } catch (error) {
        showError(`The star was not kept: ${error.message}`);
      }
    });
    row.insertCell().append(button);
  };
}

export class Remarks {
  constructor(changed) {
    this.changed = changed;
    this.logs = [];
    $("remarks-cancel").addEventListener("click", () => closeDialog());
    $("remarks").querySelector("form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.keep();
    });
  }

  ask(logs) {
    this.logs = logs;
    const [one, many] = [logs[0], logs.length > 1];
    $("remarks-of").textContent = many ? `${logs.length} logs: the tags are added to those that they have.` : one.name;
    $("tags").value = many ? "" : one.tags.join(" ");
    $("note").value = many ? "" : one.note ?? "";
    $("note-label").hidden = many;
    $("remarks-wrong").hidden = true;
    openDialog($("remarks"), $("tags"));
  }

  async keep() {
    const tags = $("tags").value.split(/[\s,]+/).filter(Boolean);
    const many = this.logs.length > 1;
    try {
      for (const log of this.logs) {
        await keep(log, many ? { tags: [...new Set([...log.tags, ...tags])] } : { tags, note: $("note").value });
      }
      closeDialog(true);
    } catch (error) {
      $("remarks-wrong").textContent = error.message;
      $("remarks-wrong").hidden = false;
    }
    this.changed();
  }
}
