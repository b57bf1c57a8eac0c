// The machine: what the rig file says of a part that is turned; or else the bed that a tool moves over, or carriages.

import { Bed, axes } from "./bed.js";
import { find } from "./dom.js";
import { Lathe } from "./lathe.js";
import { Slides } from "./slides.js";

export class Machine {
  #model;
  #drawn = null;
  /** What is drawn as it comes, while something else is shown. */
  #live = null;

  constructor(model) {
    this.#model = model;
  }

  begin() {
    this.#live = null;
    this.#put(this.#made());
  }

  /** Another time is shown. */
  turn() {
    if (this.#model.past) {
      this.#live ??= this.#drawn;
      this.#put(this.#made());
    } else {
      this.#put(this.#live ?? this.#made());
      this.#live = null;
    }
  }

  #made() {
    const { rig } = this.#model;
    const slides = rig.charts.filter(({ board, motor }) => {
      const known = rig.boards.find(({ name }) => name === board);
      return known.motors[motor]?.capabilities.includes("Axis");
    });
    const bed = axes(rig);
    if (rig.part) return new Lathe(this.#model);
    if (bed) return new Bed(this.#model, bed);
    return slides.length ? new Slides(this.#model, slides) : null;
  }

  #put(drawn) {
    this.#drawn = drawn;
    find("machine").hidden = !this.#drawn;
    find("machine-drawing").replaceChildren(...(this.#drawn ? [this.#drawn.element] : []));
  }

  draw() {
    if (this.#model.state) this.#drawn?.draw();
  }
}
