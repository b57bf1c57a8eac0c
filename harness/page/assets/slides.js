// Carriages on their screws: where each is, and where it is to be.

import { draw, make, put, set, size } from "./dom.js";
import { physical, ticks } from "./charts.js";
import { number, say } from "./words.js";

const [SIDE, SCREW, AXIS, HEIGHT] = [16, 46, 92, 112];
/** Between two marks of the scale, in px. */
const MARKS = 70;

export class Slides {
  #model;
  #slides;

  constructor(model, charts) {
    this.#model = model;
    this.#slides = charts.map((chart) => this.#slide(chart));
    this.element = make("div", {}, ...this.#slides.map(({ element }) => element));
  }

  #slide(chart) {
    const scale = draw("g", { class: "scale" });
    const thread = draw("path", { class: "thread" });
    const asked = draw("path", { d: "M0 14V78", class: "asked" });
    const carriage = draw("g", { class: "carriage" }, draw("rect", { x: -26, y: 24, width: 52, height: 32, rx: 5 }),
      draw("path", { d: "M0 56V76", class: "pointer" }));
    const rod = draw("rect", { x: SIDE, y: SCREW - 7, height: 14, class: "screw" });
    const ends = [0, 1].map(() => draw("rect", { y: 22, width: SIDE - 4, height: 48, class: "chuck" }));
    const picture = draw("svg", { role: "img", class: "slide" }, rod, thread, ...ends, scale, asked, carriage);
    const words = make("p", { class: "readout" });
    const element = make("div", {}, make("h3", {}, chart.name), picture, words);
    const physically = physical(chart);
    // A unit that is too small to be seen is not what the drawing is measured by.
    const seen = physically.unit === "mm" ? Math.max(physically.worth, 1e-3) : physically.worth;
    const [least, greatest] = [-seen, 200 * seen];
    const parts = { picture, rod, ends, scale, thread, asked, carriage, words };
    return { chart, element, ...parts, ...physically, seen, least, greatest };
  }

  draw() {
    for (const slide of this.#slides) this.#draw(slide);
  }

  #draw(slide) {
    const { chart, worth, unit, digits, seen } = slide;
    const model = this.#model;
    const value = (name) => (name ? model.value(chart.board, name) : 0);
    const believed = value(chart.got);
    const at = (believed + value(chart.offset)) * worth;
    const asked = (chart.asked ? value(chart.asked) : believed + value(chart.rest)) * worth;
    this.#scale(slide, at, asked);
    const { x, width } = slide;
    set(slide.carriage, "transform", `translate(${x(at).toFixed(2)} 0)`);
    set(slide.asked, "transform", `translate(${x(asked).toFixed(2)} 0)`);
    // The thread goes on as the screw turns.
    const turn = (((at / (seen * 60)) % 1) + 1) % 1;
    const threads = Array.from({ length: Math.floor((width - 2 * SIDE) / 9) }, (_, n) => SIDE + (n + turn) * 9);
    set(slide.thread, "d", threads.map((x) => `M${x.toFixed(1)} ${SCREW + 7}l4 -14`).join(""));
    const [is, wanted] = [at, asked].map((place) => `${number(place, digits)} ${unit}`);
    put(slide.words, `${say("position")} ${is} · ${say("asked")} ${wanted}`);
    set(slide.picture, "aria-label", say("slide_label", chart.name, is));
  }

  /** The scale reaches as far as the carriage has ever been or was to be, and is as wide as there is room. */
  #scale(slide, ...places) {
    const reach = [Math.min(slide.least, ...places), Math.max(slide.greatest, ...places)];
    const width = size(slide.element)[0] || 300;
    if (slide.x && width === slide.width && reach[0] === slide.least && reach[1] === slide.greatest) return;
    const most = Math.max(2, Math.floor(width / MARKS));
    const marks = ticks(reach[0], reach[1], most);
    const step = marks[1] - marks[0];
    const least = Math.floor(reach[0] / step + 1e-6) * step;
    const greatest = Math.ceil(reach[1] / step - 1e-6) * step;
    const room = 3 * SIDE;
    const x = (place) => room + ((place - least) / (greatest - least)) * (width - 2 * room);
    Object.assign(slide, { least, greatest, width, x });
    set(slide.picture, "viewBox", `0 0 ${width} ${HEIGHT}`);
    set(slide.rod, "width", width - 2 * SIDE);
    set(slide.ends[0], "x", 4);
    set(slide.ends[1], "x", width - SIDE);
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const mark = (place) => [
      draw("path", { d: `M${x(place)} ${AXIS - 14}v6` }),
      draw("text", { x: x(place), y: AXIS + 8 }, number(place, decimals)),
    ];
    const line = draw("path", { d: `M${x(least)} ${AXIS - 14}H${x(greatest)}` });
    slide.scale.replaceChildren(line, ...ticks(least, greatest, most + 2).flatMap(mark),
      draw("text", { x: width - 4, y: AXIS - 10, class: "unit" }, slide.unit));
  }
}
