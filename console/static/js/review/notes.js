// Notes at times of the log, kept beside it: written at the cursor, changed, taken away and brought back.

import { get, post } from "../api.js";
import { showError } from "../errors.js";

const $ = (id) => document.getElementById(id);

export class Notes {
  // changed: is called when there are other notes
  constructor(view, log, marks, changed) {
    Object.assign(this, { view, log, changed });
    this.address = `/api/logs/${log.id}/notes`;
    this.edited = null; // {t_s, text}: what the form is about
    this.removed = null;
    marks.tools = (note) => [
      this.tool("edit", "\u270e", `Change the note: ${note.text}`, () => this.edit(note)),
      this.tool("away", "\u00d7", `Remove the note: ${note.text}`, () => this.remove(note)),
    ];
    $("note").addEventListener("click", () => this.begin());
    $("note-cancel").addEventListener("click", () => this.close());
    $("note-undo").addEventListener("click", () => this.keep((notes) => [...notes, this.removed]));
    $("note-form").addEventListener("keydown", (event) => event.key === "Escape" && this.close());
    $("note-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const [before, text] = [this.edited, $("note-text").value.trim()];
      if (text) this.keep((notes) => [...notes.filter((note) => !same(note, before)), { t_s: before.t_s, text }]).then((kept) => kept && this.close());
    });
  }

  tool(kind, sign, title, act) {
    const button = Object.assign(document.createElement("button"), { type: "button", className: kind, textContent: sign, title });
    button.ariaLabel = title;
    button.addEventListener("click", act);
    return button;
  }

  async load() {
    try {
      this.show(await get(this.address));
    } catch (error) {
      showError(`The notes of this log are not shown: ${error.message}`);
    }
  }

  show(notes) {
    this.log.notes = notes;
    this.changed();
  }

  begin() {
    if (this.view.known) this.edit({ t_s: Number(this.view.t.toFixed(3)), text: "" });
  }

  edit(note) {
    this.edited = note;
    $("note-at").textContent = `${note.t_s.toFixed(3)} s`;
    $("note-text").value = note.text;
    $("note-form").hidden = false;
    $("note-text").focus();
  }

  close() {
    $("note-form").hidden = true;
    $("note").focus();
  }

  async remove(note) {
    if (!(await this.keep((notes) => notes.filter((each) => !same(each, note))))) return;
    this.removed = note;
    $("note-line").textContent = `Removed: ${note.text}`;
    $("note-undo").hidden = false;
  }

  // Change the notes as they are now, perhaps by another page; whether that is kept.
  async keep(change) {
    try {
      const notes = change(await get(this.address)).sort((a, b) => a.t_s - b.t_s);
      this.show(await post(this.address, notes));
      $("note-undo").hidden = true;
      return true;
    } catch (error) {
      showError(`The note was not kept: ${error.message}`);
      return false;
    }
  }
}

const same = (one, other) => one.t_s === other.t_s && one.text === other.text;
