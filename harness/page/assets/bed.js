// A machine whose tool moves over a bed, from above: the way that was asked, and the way that the carriages went, where
// the tool is in the work. Lengths are in mm, as far as the rig says what they are.

import { draw, make, palette, put, set, size, sized } from "./dom.js";
import { physical, ticks } from "./charts.js";
import { from } from "./model.js";
import { number, say } from "./words.js";

/** So many places of a way are kept. */
const PLACES = 40000;
/** Where the work is small, so much of the bed is shown, in mm; and what is shown grows by so much. */
const [LEAST, GROWS] = [80, 20];
/** Room for the scales, in px, and between two of their marks. */
const [LEFT, RIGHT, TOP, FOOT, MARKS] = [46, 28, 8, 22, 80];
const HIGHEST = 560;

/** The charts of the axes that a bed has: by the names of their motors. None, if X or Y is missing. */
export function axes(rig) {
  const named = (wanted) => rig.charts.find(({ board, motor, asked }) =>
    asked && rig.boards.find(({ name }) => name === board).motors[motor].name === wanted);
  const [x, y, z, a] = ["x", "y", "z", "a"].map(named);
  return x && y ? { x, y, z, a } : null;
}

export class Bed {
  #model;
  #axes;
  /** Of each axis, what was told last of it: where it was to be and where it was, and when that was told. */
  #told = new Map();
  /** The ways, in pieces of [x, y]. */
  #ways = { asked: [], got: [] };
  #kept = 0;
  #isDown = false;
  #view = null;
  #colours = "";

  constructor(model, found) {
    this.#model = model;
    this.#axes = Object.entries(found).filter(([, chart]) => chart);
    for (const [name, chart] of this.#axes) {
      const board = model.board(chart.board);
      const first = (quantity) => board.signals.find((signal) => signal.name === quantity).initial;
      const at = { asked: first(chart.asked), got: first(chart.got) };
      this.#told.set(name, { ...at, start: at.asked, since: { asked: -1, got: -1 }, ...physical(chart) });
    }
    const layer = (way) => make("canvas", { class: `way ${way}` });
    this.layers = { asked: layer("asked"), got: layer("got") };
    this.edge = draw("rect", { class: "edge" });
    this.scale = draw("g", { class: "scale" });
    this.tool = draw("circle", { r: 5, class: "tip" });
    this.picture = draw("svg", { role: "img", class: "bed" }, this.edge, this.scale);
    this.above = draw("svg", { "aria-hidden": "true", class: "bed" }, this.tool);
    this.frame = make("div", { class: "bed" }, this.picture, this.layers.asked, this.layers.got, this.above);
    this.words = make("p", { class: "readout" });
    this.element = make("div", {}, this.frame, this.words);
  }

  draw() {
    this.#take();
    const told = (name) => this.#told.get(name);
    const place = (way) => ["x", "y"].map((name) => told(name)[way] * told(name).worth);
    const drawn = this.#look(place("got"));
    for (const way of ["asked", "got"]) this.#stroke(way, drawn);
    const [x, y] = place("got");
    const { px, py } = this.#view;
    set(this.tool, "cx", px(x).toFixed(1));
    set(this.tool, "cy", py(y).toFixed(1));
    set(this.tool, "data-is", this.#isDown ? "down" : "up");
    const values = this.#axes.map(([name]) => {
      const { got, worth, unit, digits } = told(name);
      return `${name} ${number(got * worth, digits)} ${unit}`;
    });
    const is = say(this.#isDown ? "tool_down" : "tool_up");
    put(this.words, [...values, is].join(" · "));
    set(this.picture, "aria-label", say("bed_label", values.join(", "), is));
  }

  /** Takes what has been told since the last time, in order of time. */
  #take() {
    const news = [];
    for (const [name, chart] of this.#axes) {
      const axis = this.#told.get(name);
      for (const way of ["asked", "got"]) {
        const course = this.#model.course(chart.board, chart[way]);
        for (let n = from(course, axis.since[way]); n < course.length; n += 1) {
          const [at, value] = course[n];
          if (at > axis.since[way]) news.push({ at, name, way, value });
        }
        if (course.length) axis.since[way] = course[course.length - 1][0];
      }
    }
    news.sort((a, b) => a.at - b.at);
    for (const [n, { at, name, way, value }] of news.entries()) {
      this.#told.get(name)[way] = value;
      if (news[n + 1]?.at !== at) this.#go();
    }
  }

  /** The tool is where it is told now. It is in the work where it is to be below where it was at the start. */
  #go() {
    const z = this.#told.get("z");
    const isDown = !z || z.asked < z.start;
    for (const way of ["asked", "got"]) {
      const pieces = this.#ways[way];
      const place = ["x", "y"].map((name) => this.#told.get(name)[way] * this.#told.get(name).worth);
      const last = pieces[pieces.length - 1];
      const end = last?.places[last.places.length - 1];
      if (!isDown || (this.#isDown && last && end[0] === place[0] && end[1] === place[1])) continue;
      if (last && this.#isDown) last.places.push(place);
      else pieces.push({ places: [place], stroked: 0 });
      this.#kept += 1;
      if (this.#kept > 2 * PLACES && pieces.length > 1) this.#kept -= pieces.shift().places.length;
    }
    this.#isDown = isDown;
  }

  /** What is shown is the bed, until something is made: then it reaches as far as the tool has been since. Says whether
   * all must be redrawn. */
  #look(...places) {
    const width = size(this.element)[0] || 300;
    const old = this.#view;
    const isBed = !this.#ways.asked.length;
    const small = ["x", "y"].map((name) => (isBed && this.#bed(name)) || [-LEAST / 2, LEAST / 2]);
    const reach = (old?.isBed === isBed ? old.reach : small).map(([least, greatest]) => [least, greatest]);
    const seen = [...places, ...Object.values(this.#ways).flatMap((pieces) => pieces.flatMap(({ places, stroked }) =>
      places.slice(Math.max(0, stroked - 1))))];
    for (const place of seen) {
      for (const n of [0, 1]) {
        if (place[n] < reach[n][0]) reach[n][0] = Math.floor(place[n] / GROWS) * GROWS;
        if (place[n] > reach[n][1]) reach[n][1] = Math.ceil(place[n] / GROWS) * GROWS;
      }
    }
    const colours = JSON.stringify(palette());
    const same = old && old.width === width && JSON.stringify(old.reach) === JSON.stringify(reach);
    if (same && colours === this.#colours) return false;
    this.#colours = colours;
    const [[left, right], [low, high]] = reach;
    const scale = Math.min((width - LEFT - RIGHT) / (right - left), (HIGHEST - TOP - FOOT) / (high - low));
    const height = Math.ceil((high - low) * scale + TOP + FOOT);
    const middle = (LEFT + width - RIGHT) / 2;
    const px = (x) => middle + (x - (left + right) / 2) * scale;
    const py = (y) => TOP + (high - y) * scale;
    this.#view = { isBed, reach, width, height, px, py };
    this.frame.style.height = `${height}px`;
    for (const svg of [this.picture, this.above]) set(svg, "viewBox", `0 0 ${width} ${height}`);
    this.#scales(scale);
    return true;
  }

  /** From where to where an axis can go. */
  #bed(name) {
    return this.#axes.find(([other]) => other === name)[1].bed_mm;
  }

  #scales(scale) {
    const { reach: [[left, right], [low, high]], height, px, py } = this.#view;
    const bed = ["x", "y"].map((name) => this.#bed(name));
    this.edge.toggleAttribute("hidden", !(bed[0] && bed[1]));
    if (bed[0] && bed[1]) {
      const [x, y] = [px(bed[0][0]), py(bed[1][1])];
      const size = { x, y, width: px(bed[0][1]) - x, height: py(bed[1][0]) - y };
      for (const [name, value] of Object.entries(size)) set(this.edge, name, value.toFixed(1));
    }
    const most = (long) => Math.max(2, Math.floor((long * scale) / MARKS) + 1);
    const across = ticks(left, right, most(right - left)).flatMap((x, n, all) => [
      draw("path", { d: `M${px(x).toFixed(1)} ${TOP}V${height - FOOT}` }),
      draw("text", { x: px(x).toFixed(1), y: height - 6 }, number(x) + (n === all.length - 1 ? " mm" : "")),
    ]);
    const up = ticks(low, high, most(high - low)).flatMap((y) => [
      draw("path", { d: `M${px(left).toFixed(1)} ${py(y).toFixed(1)}H${px(right).toFixed(1)}` }),
      draw("text", { x: px(left) - 6, y: py(y) + 4, class: "unit" }, number(y)),
    ]);
    this.scale.replaceChildren(...across, ...up);
  }

  /** Draws what is new of a way, or all of it. */
  #stroke(way, all) {
    const { context, changed } = sized(this.layers[way]);
    if (all || changed) context.clearRect(0, 0, this.#view.width, this.#view.height);
    const { px, py } = this.#view;
    context.strokeStyle = palette()[way === "asked" ? "c1" : "c0"];
    context.lineWidth = way === "asked" ? 4 : 1.4;
    context.lineJoin = context.lineCap = "round";
    context.beginPath();
    for (const piece of this.#ways[way]) {
      const first = all || changed ? 0 : Math.max(0, piece.stroked - 1);
      if (first === piece.places.length - 1 && piece.stroked && !all && !changed) continue;
      for (const [n, [x, y]] of piece.places.slice(first).entries()) {
        if (n) context.lineTo(px(x), py(y));
        else context.moveTo(px(x), py(y));
      }
      piece.stroked = piece.places.length;
    }
    context.stroke();
  }
}
