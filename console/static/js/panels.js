// The panels of installed packages: each in a frame of an origin of its own, without network, cookies and this page. The page
// asks for a panel's data, and sends them into its frame; it takes nothing from there.

import { get } from "./api.js";
import { startFrame } from "./frame.js";

const MOST_TAKES = 20; // of the focus within TAKES_MS: faster than a person clicks
const TAKES_MS = 2000;
const FAILED_MS = 2000;

class Panel {
  constructor(section) {
    this.section = section;
    this.name = section.dataset.panel;
    this.frame = null;
    this.newest = null;
    this.takes = [];
    this.closed = false;
    this.refresh();
  }

  async refresh() {
    let waitMs = FAILED_MS;
    try {
      if (!document.hidden) {
        const { title, data, error, period_s: period } = await get(`/api/panels/${encodeURIComponent(this.name)}`);
        waitMs = 1000 * period;
        this.section.querySelector("h2").textContent = title;
        this.say(error);
        if (error === null) this.show(data);
      }
    } catch (error) {
      this.say(`This panel is not up to date: ${error.message}`);
    }
    if (!this.closed) setTimeout(() => this.refresh(), waitMs);
  }

  say(error) {
    const line = this.section.querySelector(".why");
    if (!this.closed) line.hidden = error === null;
    if (!this.closed) line.textContent = error ?? "";
  }

  show(data) {
    this.newest = data;
    if (this.closed) return;
    if (this.frame === null) this.open();
    else this.frame.contentWindow.postMessage(data, "*"); // its origin is none that could be named
  }

  open() {
    this.frame = document.createElement("iframe");
    this.frame.title = `Panel ${this.name}`;
    this.frame.tabIndex = -1;
    this.frame.sandbox = "allow-scripts";
    this.frame.src = `/panels/${encodeURIComponent(this.name)}?theme=${document.documentElement.dataset.theme}`;
    let loads = 0;
    this.frame.addEventListener("load", () => {
      loads += 1;
      if (loads > 1) this.close("left the address of its frame");
      else this.show(this.newest);
    });
    this.section.append(this.frame);
  }

  close(what) {
    this.say(`The panel ${this.name} ${what}, and was closed. Load the page again to open it.`);
    this.closed = true;
    this.frame.remove();
  }

  // Keys are the page's, since the space bar is STOP's: a frame that gets the focus loses it at once.
  giveBack() {
    this.frame.blur();
    window.focus();
    const nowMs = performance.now();
    this.takes = [...this.takes.filter((ms) => nowMs - ms < TAKES_MS), nowMs];
    if (this.takes.length > MOST_TAKES) this.close("took the keyboard again and again");
  }
}

startFrame();
const panels = [...document.querySelectorAll("[data-panel]")].map((section) => new Panel(section));
window.addEventListener("blur", () => setTimeout(() => panels.find(({ frame }) => frame !== null && frame === document.activeElement)?.giveBack()));
