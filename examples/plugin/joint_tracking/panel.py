"""A panel of the console: the force on each pad, and the largest one since the page was opened."""

from typing import Any

from rtstack.live.panel import Panel, PanelView

HTML = """
<style>td { font-size: 18px; padding-right: 12px; white-space: nowrap; } meter { width: 72px; }</style>
<table id="arms"></table>
<script>
const largest = {};
addEventListener("message", ({ data }) => {
  const rows = Object.entries(data).map(([side, newtons]) => {
    largest[side] = Math.max(largest[side] ?? 0, newtons);
    const row = document.createElement("tr");
    row.innerHTML = `<td>${side}</td><td><meter aria-label="${side}" max="100" value="${newtons}"></meter></td>
      <td>${newtons.toFixed(1)} N</td><td>at most ${largest[side].toFixed(1)} N</td>`;
    return row;
  });
  document.getElementById("arms").replaceChildren(...rows);
});
</script>
"""


def forces(view: PanelView) -> dict[str, float]:
    """Return the largest force on each arm's pad in the last 60 ms, N; nothing of an arm without a state."""
    arms: dict[str, dict[str, Any]] = {side: view.live[side] or {} for side in ("left", "right")}
    return {side: arm["peak_force_n"] for side, arm in arms.items() if arm.get("peak_force_n") is not None}


panel = Panel("Forces on the pads", HTML, forces, period_s=0.5)
