// A grab that is planned, without a demonstration: shown in the scene first, then put among the logs and chosen.

import { get, post, remove } from "./api.js";
import { showError } from "./errors.js";
import { named } from "./formats.js";
import { bodyOf } from "./jobs.js";
import { LOOKS } from "./scope.js";

const LOOK_MS = 400;
const $ = (id) => document.getElementById(id);

// used: called with the id of a plan that has become a log.
export function startPlanner(form, used) {
  const button = form.querySelector("[type=submit]");
  const about = $("plan-line").textContent;

  const show = ({ running, success, line }) => {
    button.disabled = running || LOOKS !== null;
    $("plan-cancel").hidden = $("plan-spinner").hidden = !running;
    $("plan-use").disabled = !success;
    $("plan-line").textContent = line ? `The grab ${success === false ? `cannot be planned: ${named(line.replace(/^rtstack: /, ""))}` : line}.` : about;
    $("plan-line").dataset.tone = success === null ? "" : success ? "good" : "bad";
    if (running) setTimeout(look, LOOK_MS);
  };

  const look = async () => {
    try {
      show(await get("/api/planned"));
    } catch (error) {
      show({ running: false, success: null, line: "" });
      showError(`The plan is not known: ${error.message}`);
    }
  };

  const act = async (does, failed) => {
    try {
      await does();
    } catch (error) {
      showError(`${failed}: ${error.message}.`);
      look();
    }
  };

  form.addEventListener("submit", (event) => {
    event.preventDefault();
    act(async () => show(await post("/api/planned", bodyOf(form))), "Not planned");
  });
  form.addEventListener("input", () => ($("plan-use").disabled = true)); // it is of other numbers
  $("plan-cancel").addEventListener("click", () => act(() => remove("/api/planned"), "Not cancelled"));
  $("plan-use").addEventListener("click", () => {
    $("plan-use").disabled = true;
    act(async () => used((await post("/api/planned/reference")).id), "The plan was not kept");
  });
  look();
}
