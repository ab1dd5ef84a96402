// The page Logs: the table of all logs. Those that are ticked can be compared, tagged, noted and deleted: a bar says how
// many there are. What a filter takes out of the list is ticked no longer.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { startFrame } from "../frame.js";
import { LogTable, known } from "../log_table.js";
import { startMenus } from "../menus.js";
import { Remarks, star } from "../remarks.js";
import { Trash } from "../trash.js";
import { MOST_OTHERS } from "./view.js";

const field = (id) => document.getElementById(id);
const chosen = new Set();
let searches = 0; // whose rows are not there yet

function tick(row, log) {
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = chosen.has(log.id);
  box.setAttribute("aria-label", `Tick ${log.name}`);
  box.addEventListener("change", () => {
    if (box.checked) chosen.add(log.id);
    else chosen.delete(log.id);
    showChosen();
  });
  row.insertCell().append(box);
}

const ticked = () => table.rows.filter((log) => chosen.has(log.id));

function allow(id, why, what) {
  field(id).disabled = why !== null;
  field(id).title = why ?? what;
}

function showChosen() {
  const there = new Set(table.rows.map((log) => log.id));
  for (const id of chosen) if (!there.has(id)) chosen.delete(id);
  const logs = ticked();
  const loading = searches ? "The list is being searched" : null;
  const some = logs.length >= 2 && logs.length <= MOST_OTHERS + 1 && logs.every(known);
  field("picked").hidden = logs.length === 0;
  field("picked-count").textContent = `${logs.length} ticked`;
  allow("compare", loading ?? (some ? null : `Tick two to ${MOST_OTHERS + 1} logs to compare them`), "These logs in one view, aligned at the impact");
  allow("describe", loading, "What you say about them stands beside them, in files of its own");
  allow("delete", loading, "Into the trash, from where they can be brought back");
  field("tick-all").checked = logs.length > 0 && logs.length === table.rows.length;
}

function again() {
  table.window.show(table.rows, true);
  showChosen();
}

async function copyFoxglove() {
  try {
    const { address } = await get("/api/foxglove");
    const copied = await navigator.clipboard.writeText(address).then(() => "Copied. ", () => "");
    field("foxglove-line").textContent = `${copied}In Foxglove: Open connection, Foxglove WebSocket, ${address}`;
  } catch (error) {
    showError(`There is no address: ${error.message}`);
  }
}

startFrame();
startMenus();
field("query").value = new URLSearchParams(location.search).get("q") ?? "";
const changed = async () => {
  await table.refresh();
  showChosen();
};
const filtered = async () => {
  searches += 1;
  showChosen();
  await table.search();
  searches -= 1;
  showChosen();
};
const table = new LogTable(
  field("logs"),
  () => ({ q: field("query").value.trim(), kind: field("kind").value, outcome: field("outcome").value }),
  { columns: { tick, star: star(() => changed()) }, why: field("filter-why"), onRows: () => showChosen() },
);
const remarks = new Remarks(changed);
const trash = new Trash(changed);
for (const id of ["query", "kind", "outcome"]) field(id).addEventListener("input", filtered);
field("query").addEventListener("input", () => {
  const words = field("query").value.trim();
  history.replaceState(null, "", words ? `?q=${encodeURIComponent(words)}` : "/logs");
});
field("tick-all").addEventListener("change", ({ target }) => {
  chosen.clear();
  if (target.checked) for (const log of table.rows) chosen.add(log.id);
  again();
});
field("untick").addEventListener("click", () => {
  chosen.clear();
  again();
});
field("table-csv").addEventListener("click", () => table.saveCsv("logs.csv"));
field("foxglove").addEventListener("click", copyFoxglove);
field("describe").addEventListener("click", () => remarks.ask(ticked()));
field("delete").addEventListener("click", async () => {
  const gone = await trash.remove(ticked());
  for (const id of gone) chosen.delete(id);
  await changed();
});
field("compare").addEventListener("click", () => {
  const [first, ...others] = ticked().map((log) => log.id).reverse();
  location.assign(`/logs/${first}?other=${others.join(",")}`);
});
showChosen();
