// The page Logs: the table of all logs, two of which can be compared.

import { get } from "../api.js";
import { showError } from "../errors.js";
import { startFrame } from "../frame.js";
import { LogTable } from "../log_table.js";

const field = (id) => document.getElementById(id);
const chosen = new Set();

function tick(row, log) {
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = chosen.has(log.id);
  box.disabled = log.kind === "not ours";
  box.setAttribute("aria-label", `Compare ${log.name}`);
  box.addEventListener("change", () => {
    if (box.checked) chosen.add(log.id);
    else chosen.delete(log.id);
    showChosen();
  });
  row.insertCell().append(box);
}

function showChosen() {
  const two = chosen.size === 2;
  field("compare").disabled = !two;
  field("compare").title = two ? "Both logs in one view, aligned at the impact" : "Tick two logs to compare them";
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
field("query").value = new URLSearchParams(location.search).get("q") ?? "";
const table = new LogTable(
  field("logs"),
  () => ({ q: field("query").value.trim(), kind: field("kind").value, outcome: field("outcome").value }),
  { columns: { tick } },
);
for (const id of ["query", "kind", "outcome"]) field(id).addEventListener("input", () => table.refresh());
field("query").addEventListener("input", () => {
  const words = field("query").value.trim();
  history.replaceState(null, "", words ? `?q=${encodeURIComponent(words)}` : "/logs");
});
field("table-csv").addEventListener("click", () => table.saveCsv("logs.csv"));
field("foxglove").addEventListener("click", copyFoxglove);
field("compare").addEventListener("click", () => {
  const [first, second] = table.rows.map((log) => log.id).filter((id) => chosen.has(id)).reverse();
  location.assign(`/logs/${first ?? [...chosen][0]}?other=${second ?? [...chosen][1]}`);
});
showChosen();
