// Errors stay until they are dismissed, or are not true any more: what happened, and what it means for the robot. They lie
// above the page, which stays in place.

const place = document.getElementById("errors");
const SILENT_MS = 500; // a console without a view for longer was silent
const STALE = / (is|are) not (up to date|known|shown): the console does not answer/;

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
  close.textContent = "Dismiss";
  close.addEventListener("click", () => row.remove());
  row.append(text, close);
  if (tone === "worst") place.prepend(row);
  else place.append(row);
}

// The errors about this are not true any more.
export function forgetErrors(about) {
  for (const row of place.querySelectorAll(`[data-about="${about}"]`)) row.remove();
}

// Lists that only a silent console kept old are read again once it answers, as the first view after a silence shows.
export function startErrors(live) {
  let lastMs = -Infinity;
  live.onView(() => {
    if (live.receivedMs === lastMs) return; // no new one
    const silent = live.receivedMs - lastMs > SILENT_MS;
    lastMs = live.receivedMs;
    if (silent) for (const row of [...place.children]) if (STALE.test(row.textContent)) row.remove();
  });
}
