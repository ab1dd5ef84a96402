// The page Campaigns: cards, and the chosen campaign with its figures, claims, results and report as they come in.

import { get, post } from "./api.js";
import { showWhy } from "./jobs.js";
import { forgetErrors, showError } from "./errors.js";
import { showRefusal, valuesOf } from "./field_refusal.js";
import { plain, when } from "./formats.js";
import { startFrame } from "./frame.js";
import { cell } from "./log_table.js";
import { timeLeft } from "./queue.js";
import { numberOf } from "./numbers.js";
import { listenForSpace } from "./stop.js";
import { startTabs } from "./tabs.js";
import { Results } from "./results.js";

const PERIOD_MS = 2000;
const $ = (id) => document.getElementById(id);
const BUSY = new Set(["running", "ending"]);

const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

function make(kind, className, text) {
  const element = document.createElement(kind);
  element.className = className;
  element.textContent = text;
  return element;
}

const nameOf = (campaign) => `${plain(campaign.name).replaceAll("-", " ")}${campaign.quick ? ", sample" : ""}${campaign.on_cell ? ", on the arms" : ""}`;
const WHERE = {
  simulated: "Runs on simulated arms at low priority. If the console ends, finished trials stay: press Resume then.",
  cell: "Moves the arms of this cell, one trial after another, and puts the object back in between. The campaign takes over control from you. STOP, Pause and Take over work at any time. Stay and watch.",
};
const share = (campaign) => (campaign.total ? campaign.done / campaign.total : 0);

function progressLine(campaign) {
  if (campaign.state === "failed") return campaign.message || "no reason was given";
  const of = campaign.total === null ? "" : ` of ${campaign.total}`;
  const left = campaign.state === "running" && campaign.time_left_s !== null ? `, ${timeLeft(campaign.time_left_s)}` : "";
  const next = campaign.state === "running" && campaign.next ? `, next: ${campaign.next}` : "";
  const why = campaign.message ? `: ${campaign.message.replace(/^rtstack: /, "")}` : "";
  return `${campaign.stage}: ${campaign.done}${of}${left}${next}${why}`;
}

class Page {
  constructor(live) {
    this.plans = [];
    this.campaigns = [];
    this.chosen = location.hash.slice(1);
    this.shown = { cards: "", figures: "", claims: "", report: "", says: "" };
    this.form = $("start");
    this.results = new Results($("results"), () => this.chosen);
    this.form.addEventListener("submit", (event) => this.start(event));
    $("plan-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.keepPlan(event.target);
    });
    for (const name of ["name", "quick", "on"]) this.form.elements[name].addEventListener("change", () => this.showPlan());
    $("cancel-campaign").addEventListener("click", () => this.act(`${this.chosen}/cancel`));
    $("resume").addEventListener("click", () => this.act(`${this.chosen}/resume`, { nice: this.form.elements.nice.checked }));
    $("pause").addEventListener("click", () => this.act(`${this.chosen}/pause`));
    $("go-on").addEventListener("click", () => this.act(`${this.chosen}/continue`));
    live.onView((view) => {
      this.view = view;
      this.showWhy();
    });
    $("report-frame").addEventListener("load", () => listenForSpace($("report-frame").contentWindow));
    setInterval(() => this.refresh(), PERIOD_MS);
    this.refresh();
  }

  async refresh() {
    try {
      const { plans, campaigns, folder } = await get("/api/campaigns");
      forgetErrors("campaigns");
      this.campaigns = campaigns;
      this.offer(plans);
      write($("plan-folder"), `Saved as a TOML file in ${folder}.`);
      this.show();
    } catch (error) {
      showError(`The campaigns are not up to date: ${error.message}`, "", "campaigns");
    }
  }

  async act(path, body = {}) {
    try {
      const campaign = await post(path ? `/api/campaigns/${path}` : "/api/campaigns", body);
      this.chosen = campaign.id;
      this.campaigns = [campaign, ...this.campaigns.filter((one) => one.id !== campaign.id)]; // the list has it later
      this.choose(campaign.id);
    } catch (error) {
      showError(`Nothing was changed: ${error.message}`);
    }
    await this.refresh();
  }

  async keepPlan(form) {
    try {
      const plan = await post("/api/plans", valuesOf(form, ["controllers", "objects"]));
      showRefusal(form, null);
      await this.refresh();
      this.form.elements.name.value = plan.name;
      this.form.elements.quick.checked = false; // it is small enough to be run as it is
      $("own").open = false;
      this.showPlan();
    } catch (error) {
      showRefusal(form, error.message);
    }
  }

  start(event) {
    event.preventDefault();
    const { name, quick, nice, workers, on } = this.form.elements;
    const order = { name: name.value, quick: quick.checked, nice: nice.checked, on_cell: on.value === "cell" };
    if (workers.value) order.workers = numberOf(workers);
    this.act("", order);
  }

  offer(plans) {
    if (JSON.stringify(plans) === JSON.stringify(this.plans)) return;
    const chosen = this.plans.length ? this.form.elements.name.value : "reference-spreading";
    this.plans = plans;
    this.form.elements.name.replaceChildren(...plans.map((plan) => new Option(plan.own ? `${plan.name} (your own)` : plan.name, plan.name)));
    if (plans.some((plan) => plan.name === chosen)) this.form.elements.name.value = chosen;
    this.showPlan();
  }

  showPlan() {
    const plan = this.plans.find((one) => one.name === this.form.elements.name.value);
    const trials = this.form.elements.quick.checked ? plan.quick_trials : plan.trials;
    write($("where"), WHERE[this.form.elements.on.value]);
    this.form.elements.nice.closest("label").hidden = this.form.elements.on.value === "cell";
    this.showWhy();
    if (plan.problem !== null) return write($("plan"), `This plan cannot be run: ${plan.problem}`);
    write($("plan"), trials === null ? plan.title : `${plan.title}: ${trials} trials`);
  }

  // Why none can be started now, in a line; null where one can. The server asks the same.
  whyNot(onCell) {
    if (this.plans.length === 0) return "the plans are being read";
    if (this.campaigns.some((campaign) => BUSY.has(campaign.state))) return "a campaign is running: wait until it ends, or cancel it";
    const { status, you } = this.view ?? {};
    if (!status) return "the robot process has not answered yet";
    if (onCell) return status.holder === you && status.phase === "armed" ? null : "take control and arm first (on Operate): the campaign takes over from you";
    if (status.holder !== null && status.holder !== you) return `${status.holder} has control: ask for control on Operate`;
    if (["armed", "moving"].includes(status.phase) && !this.form.elements.nice.checked) return `the arms are ${status.phase}: disarm them, or tick "Allow while the arms are armed"`;
    return null;
  }

  showWhy() {
    const plan = this.plans.find((one) => one.name === this.form.elements.name.value);
    const onCell = this.form.elements.on.value === "cell";
    if (plan && plan.problem !== null) showWhy(this.form, "this plan cannot be run");
    else if (plan && onCell && !plan.on_cell) showWhy(this.form, "this plan runs on simulated arms only");
    else showWhy(this.form, this.whyNot(onCell));
    const why = this.whyNot(this.campaigns.some((campaign) => campaign.id === this.chosen && campaign.on_cell));
    $("resume").disabled = why !== null;
    $("resume").title = why ?? "Run what is missing";
  }

  choose(id) {
    this.chosen = id;
    history.replaceState(null, "", `#${id}`);
    this.show();
  }

  show() {
    $("none").hidden = this.campaigns.length > 0;
    const campaign = this.campaigns.find((one) => one.id === this.chosen) ?? this.campaigns[0];
    if (campaign) this.chosen = campaign.id;
    this.showCards();
    this.showWhy();
    $("shown").hidden = !campaign;
    if (campaign) this.showCampaign(campaign);
  }

  showCards() {
    const shown = JSON.stringify([this.chosen, this.campaigns.map((one) => [one.id, one.state, one.done, one.total, one.time_left_s, one.next])]);
    if (shown === this.shown.cards) return;
    this.shown.cards = shown;
    const focused = document.activeElement?.dataset?.id;
    $("cards").replaceChildren(...this.campaigns.map((campaign) => {
      const card = make("button", "card", "");
      card.type = "button";
      card.dataset.id = campaign.id;
      card.setAttribute("aria-pressed", String(campaign.id === this.chosen));
      const head = make("span", "", `${nameOf(campaign)}: `);
      const state = make("span", "", campaign.state);
      state.dataset.state = campaign.state;
      head.append(state);
      const bar = make("progress", "", "");
      bar.max = 1;
      bar.value = share(campaign);
      bar.setAttribute("aria-label", `Progress of ${nameOf(campaign)}`);
      card.append(head, bar, make("span", "line", `${when(campaign.began_s)}, ${progressLine(campaign)}`));
      card.addEventListener("click", () => this.choose(campaign.id));
      return card;
    }));
    document.querySelector(`.card[data-id="${focused}"]`)?.focus();
  }

  showCampaign(campaign) {
    const address = `/api/campaigns/${campaign.id}`;
    write($("title"), nameOf(campaign));
    write($("state"), campaign.state);
    $("state").dataset.state = campaign.state;
    $("share").value = share(campaign);
    write($("progress-line"), progressLine(campaign));
    $("cancel-campaign").hidden = !BUSY.has(campaign.state);
    $("cancel-campaign").disabled = campaign.state === "ending";
    $("resume").hidden = campaign.state !== "interrupted";
    const running = campaign.on_cell && campaign.state === "running";
    $("pause").hidden = !running || campaign.paused;
    $("go-on").hidden = !running || !campaign.paused;
    this.showPrompt(campaign.state === "running" ? campaign.says : "");
    $("csv").href = `${address}/csv`;
    $("csv").hidden = campaign.done === 0;
    $("report").href = `${address}/report`;
    $("report").hidden = !campaign.report;
    $("report").classList.toggle("next", campaign.state === "finished"); // what comes after it
    this.showFigures(campaign, address);
    this.showClaims(campaign);
    this.showReport(campaign, address);
    this.results.refresh(campaign.id, campaign.done);
  }

  // What a person at the arms is to do, large enough to be read from there, and spoken where that is wanted.
  showPrompt(text) {
    $("prompt").hidden = text === "";
    if (text === this.shown.says) return;
    this.shown.says = text;
    write($("says"), text);
    if (text && $("spoken").checked) speechSynthesis.speak(new SpeechSynthesisUtterance(text));
  }

  showFigures(campaign, address) {
    $("preliminary").hidden = !campaign.preliminary;
    $("no-figure").hidden = campaign.figures.length > 0;
    const shown = JSON.stringify([campaign.id, campaign.figures]);
    if (shown === this.shown.figures) return;
    this.shown.figures = shown;
    $("pictures").replaceChildren(...campaign.figures.map((drawn) => {
      const figure = document.createElement("figure");
      const image = document.createElement("img");
      image.src = `${address}/figures/${drawn.id}?drawn=${drawn.drawn_s}`;
      image.alt = drawn.name;
      const large = make("a", "", "");
      Object.assign(large, { href: image.src, target: "_blank", rel: "noopener", title: "As large as it was drawn" });
      large.append(image);
      figure.append(large, make("figcaption", "", drawn.name));
      return figure;
    }));
  }

  showClaims(campaign) {
    const table = $("claims").querySelector("table");
    table.hidden = campaign.claims.length === 0;
    $("claims").querySelector(".empty").hidden = campaign.claims.length > 0;
    const shown = JSON.stringify([campaign.id, campaign.claims]);
    if (shown === this.shown.claims) return;
    this.shown.claims = shown;
    table.tBodies[0].replaceChildren();
    const several = new Set(campaign.claims.map((claim) => claim.conditions)).size > 1;
    for (const claim of campaign.claims) {
      const row = table.tBodies[0].insertRow();
      cell(row, several ? `${claim.where} (${plain(claim.conditions)})` : claim.where);
      cell(row, claim.claim || "-");
      cell(row, claim.mark || "-");
      cell(row, claim.figures);
      cell(row, claim.verdict, "verdict").dataset.verdict = claim.verdict;
    }
  }

  showReport(campaign, address) {
    $("no-report").hidden = campaign.report;
    $("report-frame").hidden = !campaign.report;
    const shown = campaign.report ? `${address}/report?done=${campaign.done}` : "";
    if (shown === this.shown.report) return;
    this.shown.report = shown;
    if (shown) $("report-frame").src = shown;
  }
}

new Page(startFrame());
startTabs($("tabs"));
