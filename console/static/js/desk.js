// What Desk of each control box says: a line each, red where the arm cannot be moved.

export function startDesk(live) {
  if (document.getElementById("desk") === null) return;
  live.onView(({ desk }) => {
    for (const { side, ready, line, todo } of desk) {
      const shown = document.getElementById(`desk-${side}`);
      const text = [line, ...todo].join("; ");
      const words = shown.querySelector("span");
      if (words.textContent !== text) words.textContent = text;
      shown.dataset.tone = ready && todo.length === 0 ? "good" : "bad";
    }
  });
}
