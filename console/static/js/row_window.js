// The rows of a long table: those in sight and some around them are in the page, in a table that keeps its whole height.

const WHOLE = 100; // rows: a list as short as this is there as it is
const AROUND = 30;
const STEP = 10; // rows: the window moves by so many at once

export class RowWindow {
  // makeRow: returns the row (tr) of an item, which has an id.
  constructor(table, makeRow) {
    this.table = table;
    this.place = table.closest(".table");
    this.body = table.tBodies[0];
    this.makeRow = makeRow;
    this.items = [];
    this.known = new Map(); // id: row and text of an item that is there
    this.height = 32; // of a row, px
    this.place.addEventListener("scroll", () => this.draw(), { passive: true });
    new ResizeObserver(() => this.draw()).observe(this.place);
  }

  // again: also the rows whose items are the same
  show(items, again = false) {
    this.items = items;
    this.table.ariaRowCount = items.length + 1;
    const focused = document.activeElement?.closest("tr[data-id]");
    const name = focused && this.body.contains(focused) ? document.activeElement.getAttribute("aria-label") : null;
    if (again) for (const { row } of this.known.values()) row.remove();
    if (again) this.known.clear();
    this.draw();
    if (!focused || document.activeElement !== document.body) return;
    const buttons = [...(this.known.get(focused.dataset.id)?.row.querySelectorAll("a, button:enabled, input") ?? [])];
    (buttons.find((button) => button.getAttribute("aria-label") === name) ?? buttons[0])?.focus();
  }

  draw() {
    const [first, end] = this.sight();
    const wanted = new Map(this.items.slice(first, end).map((item, at) => [item.id, [item, first + at + 2]]));
    for (const [id, { row }] of this.known) {
      if (wanted.has(id)) continue;
      if (row.contains(document.activeElement)) this.place.focus({ preventScroll: true }); // it has been scrolled away
      row.remove();
      this.known.delete(id);
    }
    let next = this.body.firstElementChild;
    for (const [id, [item, index]] of wanted) {
      const text = JSON.stringify(item);
      let { row, said } = this.known.get(id) ?? {};
      if (said !== text) {
        const made = this.makeRow(item);
        made.dataset.id = id;
        if (row === next) next = made;
        if (row) row.replaceWith(made);
        row = made;
        this.known.set(id, { row, said: text });
      }
      row.ariaRowIndex = index;
      if (row === next) next = next.nextElementSibling;
      else this.body.insertBefore(row, next);
    }
    if (this.known.size) this.height = this.body.getBoundingClientRect().height / this.known.size || this.height;
    this.table.style.marginTop = `${first * this.height}px`;
    this.table.style.marginBottom = `${(this.items.length - end) * this.height}px`;
  }

  // The first row that is there, and the one after the last.
  sight() {
    const many = this.items.length;
    if (many <= WHOLE) return [0, many];
    const { scrollTop, clientHeight } = this.place;
    const at = Math.floor(scrollTop / this.height / STEP) * STEP;
    const room = Math.ceil(clientHeight / this.height / STEP) * STEP + STEP;
    const first = Math.max(0, Math.min(at, many - room) - AROUND);
    return [first, Math.min(many, at + room + AROUND)];
  }

  // The row of the item so many places after a row's, in sight.
  beside(row, by) {
    const at = this.items.findIndex(({ id }) => id === row.dataset.id) + by;
    if (!this.items[at]) return null;
    if (!this.known.has(this.items[at].id)) {
      this.place.scrollTop = at * this.height;
      this.draw();
    }
    return this.known.get(this.items[at].id).row;
  }
}
