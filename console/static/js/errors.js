// Errors stay until read: what happened, and what it means for the robot. They lie above the page, which stays in place.

const place = document.getElementById("errors");

// tone: "worst" where the robot goes on although it was stopped; it comes first. about: for `forgetErrors`.
export function showError(what, tone = "", about = "") {
  for (const shown of place.querySelectorAll("p")) if (shown.textContent === what) return;
  const row = document.createElement("div");
  row.className = "error";
  row.dataset.tone = tone;
  row.dataset.about = about;
  const text = document.createElement("p");
  text.textContent = what;
  const close = document.createElement("button");
  close.type = "button";
  close.className = "small";
  close.textContent = "Read";
  close.addEventListener("click", () => row.remove());
  row.append(text, close);
  if (tone === "worst") place.prepend(row);
  else place.append(row);
}

// What has been overtaken: the errors about this go without having been read.
export function forgetErrors(about) {
  for (const row of place.querySelectorAll(`[data-about="${about}"]`)) row.remove();
}
