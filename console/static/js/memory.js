// What was chosen stays chosen: fields keep their values over a reload and a visit of another page, in this browser.

// Keep the fields under a name.
export function remember(name, fields) {
  const key = `rtstack.fields ${name}`;
  const known = JSON.parse(localStorage.getItem(key) ?? "{}");
  const kept = [...fields].filter((field) => field.name || field.id);
  // boxes of one name are a list to tick: each is kept by itself
  const nameOf = (field) => (field.type === "checkbox" && field.name ? `${field.name} ${field.value}` : field.name || field.id);
  for (const field of kept) {
    const value = known[nameOf(field)];
    if (value === undefined) continue;
    field.dataset.remembered = value; // a list may not be known yet
    if (field.type === "radio") field.checked = field.value === value;
    else if (field.type === "checkbox") field.checked = value;
    else if (field.tagName !== "SELECT" || [...field.options].some((option) => option.value === value)) field.value = value;
  }
  const keep = ({ target: field }) => {
    if (field.type === "radio" && !field.checked) return;
    known[nameOf(field)] = field.type === "checkbox" ? field.checked : field.value;
    localStorage.setItem(key, JSON.stringify(known));
  };
  for (const field of kept) for (const event of ["input", "change"]) field.addEventListener(event, keep);
}
