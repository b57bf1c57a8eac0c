// The machine: what the rig file says of a part that is turned, or else its carriages.

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
    this.#drawn = rig.part ? new Lathe(this.#model) : slides.length ? new Slides(this.#model, slides) : null;
    find("machine").hidden = !this.#drawn;
    find("machine-drawing").replaceChildren(...(this.#drawn ? [this.#drawn.element] : []));
  }

  draw() {
    if (this.#model.state) this.#drawn?.draw();
  }
}
