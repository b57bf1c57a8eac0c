// Every quantity of every board.

import { find, make, put } from "./dom.js";
import { number, plain, say } from "./words.js";

/** Numbers for people change so many times a second at the most. */
const TIMES = 5;

export class Status {
  #model;
  #cells = [];
  #drawn = 0;

  constructor(model) {
    this.#model = model;
  }

  begin() {
    this.#cells = [];
    // New cells are filled at once.
    this.#drawn = 0;
    find("tables").replaceChildren(...this.#model.rig.boards.map((board) => this.#table(board)));
  }

  #table(board) {
    const process = make("span", { class: "dim" });
    this.#cells.push([process, () => this.#process(board.name)]);
    const rows = board.signals.map((signal) => {
      const value = make("td", { class: "n" });
      this.#cells.push([value, () => number(this.#model.value(board.name, signal.name))]);
      return make("tr", {}, make("th", { scope: "row" }, plain(signal.name)), value, make("td", {}, signal.unit));
    });
    return make("div", {}, make("h3", {}, board.name, " ", process), make("table", {}, make("tbody", {}, ...rows)));
  }

  #process(name) {
    const state = this.#model.boardState(name);
    return state ? `${state.process}, ${say("process")} ${state.pid}` : "";
  }

  /** Another time is shown. */
  turn() {
    this.#drawn = 0;
  }

  draw() {
    const now = performance.now();
    if (now - this.#drawn < 1000 / TIMES) return;
    this.#drawn = now;
    for (const [cell, text] of this.#cells) put(cell, text());
  }
}
