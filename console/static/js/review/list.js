// The page Logs: search and sort are the server's, so that a program can ask for the same.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { number, plain, size, when } from "../formats.js";
import { startFrame } from "../frame.js";
import { save } from "./saving.js";

const REFRESH_MS = 5000;
const body = document.querySelector("#logs tbody");
const buttons = [...document.querySelectorAll("#logs th button")];
const field = (id) => document.getElementById(id);
const chosen = new Set();
const state = { key: "when", descending: true, rows: [], shown: "" };

function cell(row, text, kind = "") {
  const element = row.insertCell();
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

function addRow(log) {
  const row = body.insertRow();
  row.dataset.id = log.id;
  const tick = document.createElement("input");
  tick.type = "checkbox";
  tick.checked = chosen.has(log.id);
  tick.disabled = log.kind === "not ours";
  tick.setAttribute("aria-label", `Compare ${log.name}`);
  tick.addEventListener("change", () => {
    if (tick.checked) chosen.add(log.id);
    else chosen.delete(log.id);
    showChosen();
  });
  row.insertCell().append(tick);
  cell(row, when(log.when));
  const name = row.insertCell();
  if (log.kind === "not ours") name.textContent = log.name;
  else name.append(link(`/logs/${log.id}`, log.name));
  cell(row, log.kind);
  cell(row, plain(log.controller));
  cell(row, plain(log.object));
  cell(row, number(log.displacement_mm, 0), "number");
  cell(row, plain(log.seed), "number");
  const outcome = cell(row, log.outcome, "outcome");
  outcome.dataset.outcome = log.success === null ? "none" : log.success ? "success" : "failure";
  outcome.title = log.note ? `${log.outcome}; note: ${log.note}` : log.outcome;
  cell(row, plain(log.verdict));
  cell(row, number(log.average_force_norm, 1), "number");
  cell(row, number(log.max_lift_mm, 0), "number");
  cell(row, size(log.size_bytes), "number");
  const file = link(`/api/logs/${log.id}/download`, "MCAP");
  file.download = log.name;
  row.insertCell().append(file);
}

function link(address, text) {
  const element = document.createElement("a");
  element.href = address;
  element.textContent = text;
  return element;
}

function showChosen() {
  const two = chosen.size === 2;
  field("compare").disabled = !two;
  field("compare").title = two ? "Both logs in one view, aligned at the impact" : "Tick two logs to compare them";
}

function show() {
  const shown = JSON.stringify(state.rows);
  if (shown === state.shown) return; // nothing new: what has the focus keeps it
  state.shown = shown;
  body.replaceChildren();
  for (const log of state.rows) addRow(log);
  const searching = field("query").value.trim() || field("kind").value || field("outcome").value !== "any";
  field("empty").hidden = state.rows.length > 0;
  field("empty").textContent = searching
    ? "No log matches. Every word has to occur in a log's metadata."
    : "No log yet. Record a demonstration on the page Operate.";
  field("count").textContent = state.rows.length === 1 ? "1 log" : `${state.rows.length} logs`;
}

let asked = 0;
async function refresh() {
  const number = ++asked;
  const query = new URLSearchParams({
    q: field("query").value.trim(), kind: field("kind").value, outcome: field("outcome").value,
    sort: state.key, descending: state.descending,
  });
  history.replaceState(null, "", field("query").value.trim() ? `?q=${encodeURIComponent(field("query").value.trim())}` : "/logs");
  try {
    const rows = await get(`/api/logs?${query}`);
    if (number !== asked) return; // a newer question is on its way
    state.rows = rows;
    show();
  } catch (error) {
    showError(`The list of logs is not up to date: ${error.message}`);
  }
}

function sortBy(key) {
  state.descending = state.key === key ? !state.descending : key === "when";
  state.key = key;
  for (const button of buttons) {
    const heading = button.closest("th");
    if (button.dataset.key === key) heading.setAttribute("aria-sort", state.descending ? "descending" : "ascending");
    else heading.removeAttribute("aria-sort");
  }
  refresh();
}

function saveTable() {
  const names = ["name", "kind", "controller", "object", "displacement_mm", "seed", "outcome", "verdict", "average_force_norm", "max_lift_mm", "size_bytes"];
  const quoted = (value) => (value === null ? "" : `"${String(value).replaceAll('"', '""')}"`);
  const lines = [["when", ...names].join(","), ...state.rows.map((log) => [quoted(when(log.when)), ...names.map((key) => quoted(log[key]))].join(","))];
  save(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }), "logs.csv");
}

async function copyFoxglove() {
  try {
    const { address } = await get("/api/foxglove");
    await navigator.clipboard.writeText(address);
    field("foxglove-line").textContent = "Copied. In Foxglove: Open connection, Foxglove WebSocket.";
  } catch (error) {
    showError(`The address was not copied: ${error.message}`);
  }
}

startFrame();
field("query").value = new URLSearchParams(location.search).get("q") ?? "";
for (const button of buttons) button.addEventListener("click", () => sortBy(button.dataset.key));
for (const id of ["query", "kind", "outcome"]) field(id).addEventListener("input", refresh);
field("table-csv").addEventListener("click", saveTable);
field("foxglove").addEventListener("click", copyFoxglove);
field("compare").addEventListener("click", () => {
  const [first, second] = state.rows.map((log) => log.id).filter((id) => chosen.has(id)).reverse();
  location.assign(`/logs/${first ?? [...chosen][0]}?other=${second ?? [...chosen][1]}`);
});
showChosen();
refresh();
setInterval(refresh, REFRESH_MS);
