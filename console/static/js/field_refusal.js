// Shows why a form's input is refused: one line at the field, which is marked.

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

// Returns the values of the ticked boxes of a name.
export const ticked = (form, name) => [...form.querySelectorAll(`[name="${name}"]:checked`)].map((box) => box.value);

// Returns a field's value: a number for a number, whether a box is ticked, null for the empty choice of an optional list.
export function valueOf({ type, tagName, required, value, valueAsNumber, checked }) {
  if (type === "checkbox") return checked;
  if (type === "number") return valueAsNumber;
  return tagName === "SELECT" && !required && value === "" ? null : value;
}

// Returns the values of a form by name. lists: names of check boxes, each a list of the ticked values.
export function valuesOf(form, lists) {
  const values = {};
  for (const field of form.elements) if (field.name && field.type !== "checkbox") values[field.name] = valueOf(field);
  for (const name of lists) values[name] = ticked(form, name);
  return values;
}
