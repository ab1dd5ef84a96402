// Typed numbers, as people write them in any country. What can be read in two ways is refused with a sentence under the
// field: a number is never changed on its way to the robot.

const FIELDS = "[role=spinbutton], [data-list]"; // one number; numbers and ranges such as -60:10:60
const GROUPS = ["", "\\.", ",", "'", "[ \\u00a0]"];
const POINTS = ["", "\\.", ","];
const READINGS = GROUPS.flatMap((group) =>
  POINTS.filter((point) => !point || point !== group).map((point) => {
    const whole = group ? `[1-9]\\d{0,2}(?:${group}\\d{3})+` : "\\d*";
    return { pattern: new RegExp(`^${whole}${point && `${point}\\d*`}$`), group: new RegExp(group || "(?!)", "g") };
  }),
);
const EXPONENT = /^[+-]?(\d+\.?\d*|\.\d+)e[+-]?\d+$/i;
const GROUPED_BY_SPACE = /(?<![\d.,:'])-?[1-9]\d{0,2}(?: \d{3})+(?![\d.,:'])/; // or a list of several numbers
const ZEROS = [..."\u0660\u06f0\u0966"].map((zero) => zero.codePointAt(0)); // Arabic-Indic, Persian, Devanagari

// The same text with plain digits and signs; spaces that do not break stay apart from those between numbers.
function tidied(text) {
  return text
    .replace(/[\u200e\u200f\u061c]/g, "")
    .replace(/[\u2010-\u2015\u2212\ufe58\ufe63\uff0d]/g, "-")
    .replace(/[\u2019\u02bc\uff07\u066c]/g, "'")
    .replaceAll("\u066b", ",")
    .replace(/[\u00a0\u2007-\u200a\u202f]/g, "\u00a0")
    .replace(/[\t\n ]+/g, " ")
    .replace(/[\u0660-\u0669\u06f0-\u06f9\u0966-\u096f]/g, (digit) => ZEROS.map((zero) => digit.codePointAt(0) - zero).find((value) => value >= 0 && value < 10))
    .replace(/^[ \u00a0]+|[ \u00a0]+$/g, "");
}

// Every number that a tidy text may mean.
function readings(text) {
  if (EXPONENT.test(text)) return [Number(text)];
  const [, sign, body] = /^([+-]?)[ \u00a0]?(.*)$/.exec(text);
  if (!/\d/.test(body)) return [];
  const found = READINGS.filter(({ pattern }) => pattern.test(body)).map(({ group }) => Number(`${sign}${body.replace(group, "").replace(",", ".")}`));
  return [...new Set(found)];
}

// Returns { value } or { refusal }, a sentence. least and most: of the field; whole: it takes whole numbers only.
function readNumber(text, { least, most, whole }) {
  const all = readings(tidied(text));
  const fit = all.filter((value) => value >= least && value <= most && (!whole || Number.isInteger(value)));
  if (fit.length === 1) return { value: fit[0] };
  if (fit.length) return { refusal: `"${text}" may mean ${fit.join(" or ")}: write ${fit.join(" or ")}.` };
  const kind = whole ? "a whole number" : "a number";
  const range = Number.isFinite(least + most) ? ` from ${least} to ${most}` : "";
  if (all.length && all.every((value) => value < least || value > most)) return { refusal: `"${text}" is out of range: write ${kind}${range}.` };
  return { refusal: `${text ? `"${text}" is not ${kind}: write one` : `Write ${kind}`}${range}.` };
}

// Returns { value }, the same list with plain numbers, or { refusal }.
function readList(text, limits) {
  const { least, most, whole } = limits;
  const tidy = tidied(text);
  const joined = GROUPED_BY_SPACE.exec(tidy)?.[0];
  const meant = joined && Number(joined.replaceAll(" ", ""));
  if (joined && meant >= least && meant <= most) return { refusal: `"${joined}" may be ${meant} or several numbers: write ${meant} or ${joined.replaceAll(" ", "; ")}.` };
  const values = [];
  for (const part of tidy.split(/[;,]? +|;/).filter(Boolean)) {
    const ends = part.split(":");
    const pair = /^([+-]?\d+),(\d+)$/.exec(part);
    if (pair) return { refusal: `"${part}" may be ${pair[1]}.${pair[2]} or two numbers: write ${pair[1]}.${pair[2]} or ${pair[1]}; ${pair[2]}.` };
    if (part.includes(",") || ends.length > 3 || ends.some((each) => !readings(each).length)) return { refusal: `"${part}" is not a list: write ${whole ? "0, 7 or 0:4" : "-12.5, 5 or -60:10:60"}.` };
    const read = ends.map((each, at) => readNumber(each, ends.length === 3 && at === 1 ? { least: -Infinity, most: Infinity, whole } : limits));
    const wrong = read.find(({ refusal }) => refusal);
    if (wrong) return wrong;
    values.push(read.map(({ value }) => value).join(":"));
  }
  return values.length ? { value: values.join(" ") } : { refusal: "Write a number." };
}

// A field's range, and within it the room that the chosen objects have (data-rooms: by object; data-axis: of a shift).
function limitsOf(field) {
  const { min = -Infinity, max = Infinity, rooms, axis } = field.dataset;
  const all = rooms ? JSON.parse(rooms) : {};
  const chosen = [...(rooms ? field.form : field).querySelectorAll("[name=object] :checked, [name=objects]:checked")].map(({ value }) => all[value][axis]).filter(([least, most]) => least <= most);
  return { least: Math.max(min, ...chosen.map(([least]) => least)), most: Math.min(max, ...chosen.map(([, most]) => most)), whole: field.dataset.step === "1" };
}

function read(field) {
  const { list } = field.dataset;
  const limits = limitsOf(field);
  if (field.disabled || (!field.required && field.value.trim() === "")) return { value: NaN };
  return list === undefined ? readNumber(field.value.trim(), limits) : readList(field.value, limits);
}

export const isNumber = (field) => field.matches(FIELDS);

// Returns a field's number, or the plain text of its list; NaN where it is empty or refused.
export const numberOf = (field) => read(field).value ?? NaN;

// Shows at each field of a form, or of the page, why it is refused, and leads to the first one; returns whether none is.
export function allRead(place = document) {
  const wrong = [...place.querySelectorAll(FIELDS)].filter((field) => !check(field, true));
  wrong[0]?.focus();
  return wrong.length === 0;
}

const sentences = new WeakMap(); // by field

// loud: also while it can still become a number. Returns whether it is one.
function check(field, loud) {
  const { refusal = "", value = NaN } = read(field);
  const shown = refusal !== "" && (loud || !/^\s*[+-]?\s*$/.test(tidied(field.value)));
  let sentence = sentences.get(field);
  if (!sentence && shown) {
    sentence = document.createElement("p");
    sentence.className = "number-wrong";
    sentence.id = `wrong-${crypto.randomUUID()}`;
    sentence.setAttribute("role", "alert");
    sentences.set(field, sentence);
    const label = field.closest("label");
    (label.closest(".row") ?? label).after(sentence);
    field.setAttribute("aria-errormessage", sentence.id);
  }
  field.setCustomValidity(refusal);
  field.setAttribute("aria-invalid", String(shown));
  if (field.role === "spinbutton") {
    const { least, most } = limitsOf(field);
    field.ariaValueNow = Number.isNaN(value) ? null : value;
    field.ariaValueMin = Number.isFinite(least) ? least : null;
    field.ariaValueMax = Number.isFinite(most) ? most : null;
  }
  if (sentence && sentence.textContent !== refusal) sentence.textContent = refusal;
  if (sentence) sentence.hidden = !shown;
  return refusal === "";
}

function step(field, by) {
  const { least, most } = limitsOf(field);
  const { step: size = 1 } = field.dataset;
  const now = field.value.trim() === "" ? 0 : numberOf(field);
  if (Number.isNaN(now)) return;
  field.value = Math.min(Math.max(Number((now + by * size).toFixed(9)), least), most);
  for (const kind of ["input", "change"]) field.dispatchEvent(new Event(kind, { bubbles: true }));
}

export function startNumbers() {
  setTimeout(() => document.querySelectorAll(FIELDS).forEach((field) => check(field, false))); // what a form remembers
  const of = (event) => event.target instanceof Element && isNumber(event.target);
  // before every listener of a page: what is refused has not been changed, and is not sent
  window.addEventListener("input", (event) => of(event) && check(event.target, false), { capture: true });
  window.addEventListener("change", (event) => {
    const field = event.target;
    if (["object", "objects"].includes(field.name)) for (const each of field.form.querySelectorAll("[data-rooms]")) check(each, true); // their room is another one
    if (!of(event)) return;
    if (!check(field, true)) event.stopImmediatePropagation();
    else if (field.dataset.list === undefined && field.value.trim()) field.value = numberOf(field); // as it was read
  }, { capture: true });
  window.addEventListener("invalid", (event) => {
    if (!of(event)) return;
    event.preventDefault(); // its sentence stands under the field
    check(event.target, true);
    if (event.target === event.target.form.querySelector("input:invalid")) event.target.focus();
  }, { capture: true });
  window.addEventListener("submit", (event) => {
    if (allRead(event.target)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }, { capture: true });
  window.addEventListener("keydown", (event) => {
    const by = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (!by || !event.target.matches?.("[role=spinbutton]") || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    step(event.target, by);
  });
}
