// The page Access: invitations, tokens and the audit trail. What is shown once is in this page only, until it is left.

import { get, post, remove } from "./api.js";
import { ask } from "./dialog.js";
import { forgetErrors, showError } from "./errors.js";
import { when } from "./formats.js";
import { startFrame } from "./frame.js";
import { bodyOf, showWhy } from "./jobs.js";
import { cell } from "./log_table.js";

const PERIOD_MS = 5000;
const $ = (id) => document.getElementById(id);
const MAY = { view: "look", operate: "operate" };

function button(text, act) {
  const element = document.createElement("button");
  element.type = "button";
  element.textContent = text;
  element.addEventListener("click", act);
  return element;
}

// A secret that is shown once, and a button that copies it.
function showOnce(place, secret, note) {
  const said = document.createElement("p");
  said.textContent = note;
  const code = document.createElement("code");
  code.textContent = secret;
  const copy = button("Copy", async () => {
    try {
      await navigator.clipboard.writeText(secret);
      copy.textContent = "Copied";
    } catch (error) {
      showError(`Not copied: ${error.message}. Select it and copy it by hand.`);
    }
  });
  place.replaceChildren(said, code, copy);
  place.hidden = false;
  copy.focus();
}

class Page {
  constructor() {
    this.shown = { tokens: "", audit: "" };
    $("sign-out").addEventListener("click", () => this.signOut());
    $("invite").addEventListener("submit", (event) => this.order(event, "/api/invitations", "No invitation was made", ({ address, seconds }) =>
      showOnce($("invited"), address, `Works once, within ${Math.round(seconds / 60)} min, and is not shown again.`)));
    $("pair").addEventListener("submit", (event) => this.order(event, "/api/pairings", "No code was made", ({ code, address, seconds }) =>
      showOnce($("paired"), `${code.slice(0, 3)} ${code.slice(3)}`, `Type it at ${address} within ${Math.round(seconds / 60)} min; it works once.`)));
    $("token").addEventListener("submit", (event) => this.order(event, "/api/tokens", "No token was made", ({ row, word }) => {
      showOnce($("made"), word, `The token of ${row.name}. It is not shown again.`);
      $("token").elements.name.value = "";
    }));
  }

  async start() {
    const { operator, scope } = await get("/api/me");
    this.may = scope === "operate";
    $("me").textContent = `${operator}: may ${this.may ? "operate" : "look, and press STOP"}.`;
    const why = this.may ? null : "you may only look: ask an operator";
    for (const form of [$("invite"), $("pair"), $("token")]) showWhy(form, why);
    if (!this.may) $("no-token").textContent = "Only operators see the tokens.";
    setInterval(() => this.refresh(), PERIOD_MS);
    await this.refresh();
  }

  async order(event, path, failure, show) {
    event.preventDefault();
    try {
      const { scope, ...body } = bodyOf(event.target);
      const panel = /^panel (.+)$/.exec(scope)?.[1];
      show(await post(path, panel === undefined ? { scope, ...body } : { scope: "view", panel, ...body }));
      await this.refresh();
    } catch (error) {
      showError(`${failure}: ${error.message}.`);
    }
  }

  async signOut() {
    try {
      await post("/api/sign-out");
      location.assign("/");
    } catch (error) {
      showError(`Still signed in: ${error.message}.`);
    }
  }

  async refresh() {
    try {
      if (this.may) this.showTokens(await get("/api/tokens"));
      this.showAudit((await get("/api/audit")).reverse());
      forgetErrors("access");
    } catch (error) {
      showError(`This page is not up to date: ${error.message}.`, "", "access");
    }
  }

  // Rows are written again only where something is new: what has the focus keeps it.
  rows(name, lines, fill) {
    const text = JSON.stringify(lines);
    if (text === this.shown[name]) return;
    this.shown[name] = text;
    const body = $(name).tBodies[0];
    body.replaceChildren();
    for (const line of lines) fill(body.insertRow(), line);
  }

  showTokens(tokens) {
    $("no-token").hidden = tokens.length > 0;
    this.rows("tokens", tokens, (row, token) => {
      cell(row, token.name).title = token.id;
      cell(row, token.panel === null ? MAY[token.scope] : `look at the panel ${token.panel}`);
      cell(row, when(token.created_s));
      cell(row, token.used_s === null ? "not since this console started" : when(token.used_s));
      const revoke = button("Revoke", () => this.revoke(token));
      revoke.setAttribute("aria-label", `Revoke the token of ${token.name}`);
      revoke.title = "Its program is refused from then on; this cannot be undone";
      row.insertCell().append(revoke);
    });
  }

  async revoke(token) {
    const details = "Its program is refused from then on. This cannot be undone.";
    if (!(await ask({ question: `Revoke the token of ${token.name}?`, details, yes: "Revoke", bad: true }))) return;
    try {
      await remove(`/api/tokens/${token.id}`);
    } catch (error) {
      showError(`Not revoked: ${error.message}.`);
    }
    await this.refresh();
    $("token").elements.name.focus();
  }

  showAudit(lines) {
    this.rows("audit", lines, (row, line) => {
      cell(row, when(Date.parse(line.time) / 1000));
      cell(row, line.operator ?? "");
      cell(row, line.text, "text");
    });
  }
}

startFrame();
new Page().start().catch((error) => showError(`This page is not shown: ${error.message}.`));
