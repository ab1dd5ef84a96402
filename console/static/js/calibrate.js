// The calibration: points that the pads are led to and that are taken here, what they give, and the cell's file.

import { get, post, remove } from "./api.js";
import { ask } from "./dialog.js";
import { showError } from "./errors.js";
import { named } from "./formats.js";
import { numberOf } from "./numbers.js";

const LOOK_MS = 500;
const $ = (id) => document.getElementById(id);

function button(text, does) {
  const made = document.createElement("button");
  made.type = "button";
  made.className = "small";
  made.textContent = text;
  made.addEventListener("click", does);
  return made;
}

function item(text, tone = "") {
  const made = document.createElement("li");
  made.textContent = text;
  made.dataset.tone = tone;
  return made;
}

export function startCalibration(form) {
  let timer = null;
  let before = Promise.resolve();
  const rows = new Map(); // by the points' names
  const { what, side, object } = form.elements;
  const place = ["x", "y", "z"].map((axis) => form.elements[axis]);

  // one request after the other: an answer that is overtaken would show what is no more
  const does = (act, failed) => {
    before = before.then(async () => {
      try {
        show(await act());
      } catch (error) {
        showError(`${failed}: ${error.message}. The cell's file stays as it is.`);
      }
    });
  };

  // made once: a button that is replaced while it is pressed gets no click, and loses the focus
  const makeRow = ({ name, what, asked }) => {
    const line = document.createElement("tr");
    const [words, , buttons] = ["td", "td", "td"].map((kind) => line.appendChild(document.createElement(kind)));
    words.textContent = `${name.replaceAll("_", " ")}: ${named(asked)}`;
    if (what !== "stand") buttons.append(button("Take", () => does(() => post(`/api/calibration/points/${name}/take`), "Not taken")));
    buttons.append(button("Remove", () => does(() => remove(`/api/calibration/points/${name}`), "Not removed")));
    rows.set(name, line);
    $("calibration-points").prepend(line); // the newest is the one that is to be taken
    return line;
  };

  const showPoint = (point) => {
    const [, result, buttons] = (rows.get(point.name) ?? makeRow(point)).cells;
    const off = point.off_mm === null ? "taken" : `${point.off_mm.toFixed(2)} mm`;
    result.textContent = !point.measured ? "to do" : point.wrong ? `${off} WRONG, left out: take it again` : off;
    result.dataset.tone = point.wrong ? "bad" : point.measured ? "good" : "";
    if (point.what !== "stand") buttons.firstChild.textContent = point.measured ? "Again" : "Take";
  };

  const show = (view) => {
    clearTimeout(timer);
    const names = view.points.map((point) => point.name);
    for (const [name, line] of rows) if (!names.includes(name)) rows.delete(name) && line.remove();
    view.points.forEach(showPoint);
    const known = view.date === null ? "has no date of a calibration" : `was calibrated on ${view.date}, rms ${view.rms_mm} mm, pads within ${view.uncertainty_mm} mm`;
    $("calibration-now").textContent = `${view.file} ${known}.`;
    const wrong = view.points.filter((point) => point.wrong).map((point) => point.name);
    const found = view.looking ? ["Looking at the points."] : view.lines;
    $("calibration-found").replaceChildren(...wrong.map((name) => item(`${name}: WRONG`, "bad")), ...found.map((text) => item(text)));
    const values = Object.entries(view.values).map(([key, value]) => item(`${key} = ${value}`));
    $("calibration-values").replaceChildren(...values);
    $("calibration-new").hidden = values.length === 0;
    $("calibration-why").textContent = view.why ?? "";
    $("calibration-write").disabled = view.looking || view.why !== null || view.lines.length === 0;
    if (view.looking) timer = setTimeout(look, LOOK_MS);
  };

  const look = () => does(() => get("/api/calibration"), "The calibration is not up to date");

  const needsPlace = () => {
    for (const field of place) field.required = !(field.disabled = !["touch", "see", "stand"].includes(what.value));
    side.disabled = !["touch", "see"].includes(what.value);
    object.disabled = what.value !== "stand";
    side.closest("label").hidden = !object.disabled;
    object.closest("label").hidden = object.disabled;
  };
  what.addEventListener("change", needsPlace);
  needsPlace();

  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const body = { what: what.value };
    if (!side.disabled) body.side = side.value;
    if (!object.disabled) body.object = object.value;
    if (!place[0].disabled) body.place = place.map(numberOf);
    const stem = [body.what, body.side ?? body.object].filter(Boolean).join("-");
    const add = () => {
      let number = 1;
      while (rows.has(`${stem}-${number}`)) number += 1;
      return post(`/api/calibration/points/${stem}-${number}`, body);
    };
    does(add, "Not added");
  });
  $("calibration-write").addEventListener("click", async () => {
    const details = "Bases, tracker, and the date with its errors. After it the stack has to be started again.";
    if (await ask({ question: "Write this into the cell's file?", details, yes: "Write" })) does(() => post("/api/calibration/write"), "Not written");
  });
  look();
}
