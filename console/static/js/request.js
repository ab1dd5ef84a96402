// Another operator asks for control: the question stands above every page of its holder until it is answered.

import { post } from "./api.js";
import { showError } from "./errors.js";

const place = document.getElementById("errors");

const button = (text, path) => {
  const made = document.createElement("button");
  made.type = "button";
  made.className = "small";
  made.textContent = text;
  made.addEventListener("click", () => post(path).catch((error) => showError(`Control was not handed over: ${error.message}.`)));
  return made;
};

export function startRequest(live) {
  const row = document.createElement("div");
  row.className = "error";
  row.dataset.tone = "question";
  const text = document.createElement("p");
  row.append(text, button("Hand over", "/api/request/give"), button("Keep control", "/api/request/keep"));
  live.onView(({ request, you }) => {
    const open = Boolean(request) && request.holder === you && !request.kept;
    if (open && !row.isConnected) place.prepend(row);
    if (!open) row.remove();
    const question = open ? `${request.operator} asks for control.` : "";
    if (text.textContent !== question) text.textContent = question;
  });
}
