// Shows why a form's input is refused: one line at the field, which is marked.

import { isNumber, numberOf } from "./numbers.js";

// form: with a .wrong and [data-field]s; what: "field: why", a line about no field, or null.
export function showRefusal(form, what) {
  const wrong = form.querySelector(".wrong");
  const field = what === null ? null : form.querySelector(`[data-field="${what.split(":")[0].split(".")[0]}"]`);
  for (const element of form.querySelectorAll("[data-field]")) {
    const input = element.querySelector("input:not([type=checkbox])");
    input?.setAttribute("aria-invalid", String(element === field || input.validity.customError));
    element.classList.toggle("invalid", element === field);
  }
  wrong.hidden = what === null;
  const text = field ? what.slice(what.indexOf(":") + 2) : what ?? "";
  if (wrong.textContent !== text) wrong.textContent = text;
  const details = field?.closest("details");
  if (details) details.open = true;
  if (field) field.after(wrong);
  else form.querySelector(".fields").append(wrong);
}

// Returns the values of the ticked boxes of a name.
export const ticked = (form, name) => [...form.querySelectorAll(`[name="${name}"]:checked`)].map((box) => box.value);

// Returns a field's value: a number for a number, plain text for a list of them, whether a box is ticked, null for the empty choice of an optional list.
export function valueOf(field) {
  const { type, tagName, required, value, checked } = field;
  if (type === "checkbox") return checked;
  if (isNumber(field)) return numberOf(field);
  return tagName === "SELECT" && !required && value === "" ? null : value;
}

// Returns the values of a form by name. lists: names of check boxes, each a list of the ticked values.
export function valuesOf(form, lists) {
  const values = {};
  for (const field of form.elements) if (field.name && field.type !== "checkbox") values[field.name] = valueOf(field);
  for (const name of lists) values[name] = ticked(form, name);
  return values;
}
