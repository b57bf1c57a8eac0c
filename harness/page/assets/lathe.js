// The lathe from the side: the chuck at the left, the bar as it is cut, and the tool. Lengths are in mm.

import { draw, find, make, put, set } from "./dom.js";
import { number, say } from "./words.js";

/** Lines along the bar that show how it turns. */
const SEAMS = 3;
/** It is seen to turn no faster than this, in turns a second: faster, an eye sees it go backwards. */
const TURNS = 2.5;
/** Room around the bar, in mm. */
const [LEFT, RIGHT, AROUND] = [16, 16, 8];

export class Lathe {
  #model;
  #part;
  #angle = 0;
  #at = 0;
  #outline = null;
  #radius = () => 0;

  constructor(model) {
    this.#model = model;
    this.#part = model.rig.part;
    const { out_mm: out, diameter_mm: diameter, chuck_mm: chuck } = this.#part;
    const radius = diameter / 2;
    // Only as much of the jaws as helps to see where they are.
    const jaws = Math.min((chuck ?? diameter * 1.6) / 2, radius * 1.7);
    const half = Math.max(jaws, radius + AROUND);
    const box = [-out - LEFT, -half - 2, out + LEFT + RIGHT, 2 * half + 4];
    this.asCut = draw("path", { class: "bar" });
    this.stock = draw("rect", { x: -out, y: -radius, width: out, height: diameter, class: "stock" });
    this.seams = Array.from({ length: SEAMS }, () => draw("path", { class: "seam" }));
    this.bore = draw("path", { class: "bore" });
    this.tool = draw("path", { class: "tool", d: this.#toolPath() });
    const chuckShape = draw("g", { class: "chuck" },
      draw("rect", { x: -out - LEFT, y: -jaws, width: LEFT - 3, height: 2 * jaws, rx: 1 }),
      draw("rect", { x: -out - 5, y: -radius - 3.5, width: 5, height: 3.5 }),
      draw("rect", { x: -out - 5, y: radius, width: 5, height: 3.5 }));
    const axis = draw("path", { d: `M${-out - LEFT} 0H${RIGHT}`, class: "axis" });
    this.picture = draw("svg", { viewBox: box.join(" "), role: "img", class: "lathe" },
      this.stock, this.asCut, this.bore, ...this.seams, axis, chuckShape, this.tool);
    this.words = make("p", { class: "readout" });
    this.element = make("div", {}, this.picture, this.words);
  }

  /** A tip at (0, 0), as it cuts the surface from outside; inside, the other way round. */
  #toolPath() {
    const nose = this.#part.nose_mm;
    const way = this.#inside ? -1 : 1;
    return `M0 ${-way * nose}Q0 0 ${nose} 0L9 ${-way * 6}V${-way * 15}H0Z`;
  }

  get #inside() {
    return this.#part.side === "inside";
  }

  draw() {
    const { part, state } = this.#model;
    const { z, x, spindle, surface_mm: surface } = this.#part;
    const rpm = this.#model.source(spindle);
    const at = z.start_mm + this.#model.source(z.way);
    const height = surface / 2 + x.start_mm + this.#model.source(x.way);
    this.#cut(part);
    this.#turn(rpm, state);
    // The tool stands above the middle on the page, where less is more radius.
    set(this.tool, "transform", `translate(${at.toFixed(3)} ${(-height).toFixed(3)})`);
    const values = [number(rpm), number(at, 2), number(2 * height, 2)];
    put(this.words, `${values[0]} ${say("rpm")} · z ${values[1]} mm · ⌀ ${values[2]} mm`);
    set(this.picture, "aria-label", say("lathe_label", ...values));
  }

  /** The bar as it is cut, and what should not have happened. */
  #cut(part) {
    if (!part || part === this.#outline) return;
    this.#outline = part;
    const { diameter_mm: diameter, out_mm: out, bore_mm: bore } = this.#part;
    const corners = part.outline;
    const shape = (points) => {
      const upper = points.map(([z, x]) => `${z.toFixed(3)} ${(-x).toFixed(3)}`);
      const lower = points.map(([z, x]) => `${z.toFixed(3)} ${x.toFixed(3)}`).reverse();
      return `M${upper.join("L")}L${lower.join("L")}Z`;
    };
    const bar = [[0, diameter / 2], [-out, diameter / 2]];
    set(this.asCut, "d", shape(this.#inside ? bar : corners));
    const hole = this.#inside ? corners : [[0, bore / 2], [-out, bore / 2]];
    set(this.bore, "d", bore || this.#inside ? shape(hole) : "");
    this.#radius = (place) => corners.find(([z]) => z <= place)?.[1] ?? diameter / 2;
    const events = part.events.map(({ event, from_s: from, z_mm: z, worst, unit }) => {
      const place = `${from.toFixed(3)} s, z ${number(z, 2)} mm`;
      return make("li", {}, `${say(`event_${event}`)}: ${place}, ${number(worst, 2)} ${unit}`);
    });
    find("part-events").hidden = !events.length;
    find("part-events").replaceChildren(...events);
  }

  /** Seams run along the bar, and go round with it. */
  #turn(rpm, state) {
    const wall = performance.now() / 1000;
    const passed = Math.min(wall - this.#at, 0.1);
    this.#at = wall;
    if (!state.paused) {
      const pace = state.pace === "max" ? 1 : Number(state.pace);
      const turns = Math.min(TURNS, Math.abs((rpm / 60) * pace));
      this.#angle += 2 * Math.PI * turns * Math.sign(rpm) * passed;
    }
    const { out_mm: out } = this.#part;
    const corners = this.#inside || !this.#outline ? null : this.#outline.outline;
    const radius = this.#part.diameter_mm / 2;
    for (const [n, seam] of this.seams.entries()) {
      const angle = this.#angle + (2 * Math.PI * n) / SEAMS;
      // What is behind the bar is not seen.
      set(seam, "visibility", Math.cos(angle) > 0 ? "visible" : "hidden");
      const point = ([z, x]) => `${z.toFixed(2)} ${(Math.sin(angle) * x).toFixed(2)}`;
      set(seam, "d", `M${(corners ?? [[0, radius], [-out, radius]]).map(point).join("L")}`);
    }
  }
}
