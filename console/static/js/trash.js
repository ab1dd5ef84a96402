// Deleted logs: what was deleted last comes back by one click, the others from the list; nothing asks before it deletes.

import { get, post } from "./api.js";
import { ask } from "./dialog.js";
import { showError } from "./errors.js";
import { size, when } from "./formats.js";

const $ = (id) => document.getElementById(id);

export class Trash {
  constructor(changed) {
    this.changed = changed;
    this.last = []; // what was deleted together, by one click
    $("undo").addEventListener("click", () => this.restore(this.last));
    $("empty-trash").addEventListener("click", () => this.empty());
    this.refresh();
  }

  async refresh() {
    try {
      this.show(await get("/api/trash"));
    } catch (error) {
      showError(`What was deleted is not up to date: ${error.message}`);
    }
  }

  show({ logs, size_bytes, kept_days }) {
    $("trash").hidden = logs.length === 0;
    $("trash-line").textContent = `${logs.length === 1 ? "1 log" : `${logs.length} logs`}, ${size(size_bytes)}; each stays for ${kept_days} days`;
    const known = new Set(logs.map((log) => log.id));
    this.last = this.last.filter((id) => known.has(id));
    if (!this.last.length && logs.length) this.last = [logs[0].id];
    $("undo").textContent = this.last.length > 1 ? `Undo: bring ${this.last.length} logs back` : "Undo";
    $("trashed").replaceChildren(...logs.map((log) => {
      const [row, back] = [document.createElement("li"), document.createElement("button")];
      back.type = "button";
      back.className = "small";
      back.textContent = "bring back";
      back.addEventListener("click", () => this.restore([log.id]));
      row.append(`${log.name}, ${size(log.size_bytes)}, deleted ${when(log.deleted_s)} `, back);
      return row;
    }));
  }

  // Returns the ids of the logs that are gone; says why another one is not.
  async remove(logs) {
    const gone = [];
    const trashed = [];
    for (const log of logs) {
      try {
        trashed.push((await post(`/api/logs/${log.id}/delete`)).id);
        gone.push(log.id);
      } catch (error) {
        showError(`${log.name} was not deleted: ${error.message}.`);
      }
    }
    if (trashed.length) this.last = trashed;
    await this.refresh();
    return gone;
  }

  async restore(ids) {
    for (const id of ids) {
      try {
        await post(`/api/trash/${id}/restore`);
      } catch (error) {
        showError(`Not brought back: ${error.message}.`);
      }
    }
    await this.refresh();
    await this.changed();
  }

  async empty() {
    if (!(await ask({ question: "Remove the deleted logs for good?", details: $("trash-line").textContent, yes: "Remove", bad: true }))) return;
    try {
      this.show(await post("/api/trash/empty"));
    } catch (error) {
      showError(`Not removed: ${error.message}.`);
    }
  }
}
