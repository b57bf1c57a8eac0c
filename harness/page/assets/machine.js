// The machine: what the rig file says of a part that is turned; or else the bed that a tool moves over, or carriages.

import { Bed, axes } from "./bed.js";
import { find } from "./dom.js";
import { Lathe } from "./lathe.js";
import { Slides } from "./slides.js";

export class Machine {
  #model;
  #drawn = null;

  constructor(model) {
    this.#model = model;
  }

  begin() {
    const { rig } = this.#model;
    const slides = rig.charts.filter(({ board, motor }) => {
      const known = rig.boards.find(({ name }) => name === board);
      return known.motors[motor]?.capabilities.includes("Axis");
    });
    const bed = axes(rig);
    if (rig.part) this.#drawn = new Lathe(this.#model);
    else if (bed) this.#drawn = new Bed(this.#model, bed);
    else this.#drawn = slides.length ? new Slides(this.#model, slides) : null;
    find("machine").hidden = !this.#drawn;
    find("machine-drawing").replaceChildren(...(this.#drawn ? [this.#drawn.element] : []));
  }

  draw() {
    if (this.#model.state) this.#drawn?.draw();
  }
}
