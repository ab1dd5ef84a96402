// In a narrow window a row of a table is a card: each cell has its column's heading as a label, for the style sheet.

function label(table) {
  const headings = [...table.querySelectorAll("thead th")].map((each) => (each.querySelector(".hidden") ?? each).textContent.trim()); // words, not a sign
  for (const row of table.querySelectorAll("tbody tr")) {
    [...row.cells].forEach((cell, place) => {
      if (cell.dataset.label !== headings[place]) cell.dataset.label = headings[place] ?? "";
    });
  }
}

export function startLabels() {
  for (const table of document.querySelectorAll("main table")) {
    label(table);
    new MutationObserver(() => label(table)).observe(table, { childList: true, subtree: true });
  }
}
