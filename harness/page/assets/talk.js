// What happens, in words: the latest first.

import { fill, find, make, put } from "./dom.js";
import { instant, plain, say } from "./words.js";

/** So many rows are listed. */
const LISTED = 200;
const KINDS = ["all", "frames", "events", "inputs"];
const MARKS = { frames: ">", events: "*", inputs: "<" };

export class Talk {
  #model;
  /** How far the list is scrolled: to ask it lays the page out again. */
  #above = 0;

  constructor(model) {
    this.#model = model;
    find("talk-of").addEventListener("change", () => this.begin());
    find("rows").addEventListener("scroll", ({ target }) => { this.#above = target.scrollTop; }, { passive: true });
  }

  begin() {
    fill(find("talk-of"), KINDS, (kind) => say(`show_${kind}`), "all");
    this.#list();
    const rows = this.#model.listed.filter((row) => this.#shows(row)).slice(-LISTED).reverse();
    find("rows").replaceChildren(...rows.map(element));
    this.#none();
  }

  /** Another time is shown. */
  turn() {
    this.begin();
  }

  /** What was not listed yet is from now on; gives it. */
  #list() {
    const { fresh, listed } = this.#model;
    const news = fresh.splice(0);
    listed.push(...news);
    if (listed.length > 5 * LISTED) listed.splice(0, listed.length - 4 * LISTED);
    return news;
  }

  #shows(row) {
    const kind = find("talk-of").value;
    return kind === "all" || row.kind === kind;
  }

  #none() {
    if (!find("rows").children.length) find("rows").append(make("p", { class: "dim none" }, say("none_yet")));
  }

  draw() {
    const fresh = this.#list();
    const { lost, leftOut } = this.#model;
    const missing = [lost && say("lost_updates", lost), leftOut && say("lost_rows", leftOut)];
    put(find("lost"), missing.filter(Boolean).join(" "));
    if (!fresh.length) return;
    const list = find("rows");
    const shown = fresh.filter((row) => this.#shows(row)).slice(-LISTED).reverse();
    if (!shown.length) return;
    list.querySelector(".none")?.remove();
    // Whoever reads further below stays there.
    const height = this.#above > 0 ? list.scrollHeight : 0;
    list.prepend(...shown.map(element));
    while (list.children.length > LISTED) list.lastChild.remove();
    if (height) list.scrollTop = this.#above + list.scrollHeight - height;
  }
}

function element(row) {
  return make("p", { class: row.flaw ? "flaw" : row.kind },
    make("time", {}, instant(row.ns * 1e-9)), " ", make("span", { class: "place" }, plain(row.line ?? row.board)), " ",
    make("span", { class: "what" }, `${row.flaw ? "!" : MARKS[row.kind] ?? ""} ${row.text}`));
}
