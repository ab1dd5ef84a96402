// Why what was typed into a form is refused: one line, at the field that it is about, which is marked.

// form: with a .wrong and [data-field]s; what: "field: why", a line about no field, or null.
export function showRefusal(form, what) {
  const wrong = form.querySelector(".wrong");
  const field = what === null ? null : form.querySelector(`[data-field="${what.split(":")[0].split(".")[0]}"]`);
  for (const element of form.querySelectorAll("[data-field]")) {
    element.querySelector("input:not([type=checkbox])")?.setAttribute("aria-invalid", String(element === field));
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

// What is ticked of a list of check boxes.
export const ticked = (form, name) => [...form.querySelectorAll(`[name="${name}"]:checked`)].map((box) => box.value);

// What a form says: numbers as numbers, lists of what is ticked.
export function valuesOf(form, lists) {
  const values = {};
  for (const { name, type, value, valueAsNumber } of form.elements) if (name && type !== "checkbox") values[name] = type === "number" ? valueAsNumber : value;
  for (const name of lists) values[name] = ticked(form, name);
  return values;
}
