// Errors stay until read: what happened, and what it means for the robot.

const place = document.getElementById("errors");

export function showError(what) {
  for (const shown of place.querySelectorAll("p")) if (shown.textContent === what) return;
  const row = document.createElement("div");
  row.className = "error";
  const text = document.createElement("p");
  text.textContent = what;
  const close = document.createElement("button");
  close.type = "button";
  close.className = "small";
  close.textContent = "Read";
  close.addEventListener("click", () => row.remove());
  row.append(text, close);
  place.append(row);
}
