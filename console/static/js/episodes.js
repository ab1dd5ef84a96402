// The recordings side by side: a small picture of the forces, the name, what was decided; the newest first.

import { get } from "./api.js";
import { plain, when } from "./formats.js";

const RETRY_MS = 1500; // a recording is read before it has a picture
const KINDS = ["recording", "demonstration"];
const TONES = { accepted: "good", rejected: "bad" };

export class Episodes {
  // id: of the recording that the page shows
  constructor(id) {
    this.id = id;
    this.place = document.getElementById("episodes");
    this.rows = [];
    this.fails = false; // what the page shows of this recording gives no reference, whatever was decided
  }

  mark(fails) {
    if (fails === this.fails) return;
    this.fails = fails;
    this.place.replaceChildren(...this.rows.map((row) => this.card(row)));
  }

  async show() {
    this.rows = (await get("/api/logs")).filter(({ kind, outcome }) => KINDS.includes(kind) && outcome !== "being written");
    this.place.replaceChildren(...this.rows.map((row) => this.card(row)));
    this.place.querySelector("[aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" });
  }

  card(row) {
    const [item, link, image, name, said] = ["li", "a", "img", "span", "small"].map((kind) => document.createElement(kind));
    link.href = `/recordings/${row.id}`;
    if (row.id === this.id) link.setAttribute("aria-current", "page");
    image.alt = "";
    image.width = 160;
    image.height = 36;
    this.picture(image, row.id);
    name.textContent = row.title || plain(row.object) || row.name;
    const fails = this.fails && row.id === this.id;
    said.textContent = `${when(row.when).slice(5, 16)}, ${fails ? "no reference from this part" : row.decision ?? "open"}`;
    said.dataset.tone = fails ? "bad" : TONES[row.decision] ?? "";
    link.title = row.name;
    link.append(image, name, said);
    item.append(link);
    return item;
  }

  // A picture that is not there yet is no error of the page: it is asked for until it is.
  async picture(image, id) {
    const answer = await fetch(`/api/recordings/${id}/thumbnail`).catch(() => null);
    if (answer?.status === 200) image.src = URL.createObjectURL(await answer.blob());
    else if (answer === null || answer.status === 202) setTimeout(() => this.picture(image, id), RETRY_MS);
  }

  // by: 1 to the older one, -1 to the newer one
  go(by) {
    const next = this.rows[this.rows.findIndex(({ id }) => id === this.id) + by];
    if (next) location.assign(`/recordings/${next.id}`);
  }
}
