// Each motor over time: its set point against its value, and below them the drive.

import { FONT, find, fill, make, palette, paper, put, set } from "./dom.js";
import { from } from "./model.js";
import { number, say } from "./words.js";

/** How much of virtual time is shown, in s. */
const WINDOWS = ["5", "20", "60", "300"];
const [LEFT, RIGHT, TOP, DRIVE, FOOT] = [52, 10, 10, 34, 20];
/** Numbers for people change so many times a second at the most. */
const TIMES = 5;

/** Marks between two values: at most `most`, at round numbers. */
export function ticks(least, greatest, most) {
  const rough = (greatest - least) / most || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((step) => step >= rough);
  const found = [];
  for (let n = Math.ceil(least / step - 1e-9); n * step <= greatest + step * 1e-9; n += 1) found.push(n * step);
  return found;
}

/** The unit for people of what a motor tells, and what one of that is worth in it. */
export const physical = ({ physical, unit }) => physical ?? { unit, worth: 1, digits: 0 };

export class Charts {
  #model;
  #charts = [];
  #said = 0;

  constructor(model) {
    this.#model = model;
    fill(find("motors-window"), WINDOWS, (seconds) => `${seconds} s`, "20");
  }

  begin() {
    this.#charts = this.#model.rig.charts.map((chart) => this.#chart(chart));
    find("charts").replaceChildren(...this.#charts.map(({ figure }) => figure));
    find("motors").hidden = !this.#charts.length;
    this.#said = 0;
  }

  #chart(chart) {
    const canvas = make("canvas", { role: "img" });
    const now = make("figcaption");
    const inUnit = physical(chart);
    const what = make("span", { class: "dim" }, `${say(chart.what)}, ${inUnit.unit}`);
    const figure = make("figure", {}, make("h3", {}, chart.name, " ", what), canvas, now);
    return { chart, figure, canvas, now, ...inUnit };
  }

  /** Another time is shown. */
  turn() {
    this.#said = 0;
  }

  draw() {
    if (!this.#model.state) return;
    for (const chart of this.#charts) this.#draw(chart);
    if (performance.now() - this.#said < 1000 / TIMES) return;
    this.#said = performance.now();
    for (const chart of this.#charts) this.#say(chart);
  }

  /** What the motor is to do; where only the way that remains is told, that follows from it. */
  asked(chart) {
    const { board, got, asked, rest } = chart;
    if (asked) return this.#model.value(board, asked);
    return rest ? this.#model.value(board, got) + this.#model.value(board, rest) : null;
  }

  #say({ chart, canvas, now, unit, worth, digits }) {
    const model = this.#model;
    const texts = [];
    const add = (what, value, unit, digits) => texts.push(`${say(what)} ${number(value, digits)} ${unit}`.trim());
    const got = model.value(chart.board, chart.got);
    const asked = this.asked(chart);
    if (asked !== null) add("asked", asked * worth, unit, digits);
    add("got", got * worth, unit, digits);
    if (asked !== null) add("error", (asked - got) * worth, unit, digits);
    const signal = (name) => model.board(chart.board).signals.find((signal) => signal.name === name);
    for (const what of ["speed", "drive"].filter((what) => chart[what])) {
      const { unit, worth, digits } = chart[`${what}_in`] ?? { unit: signal(chart[what]).unit, worth: 1, digits: 0 };
      add(what, model.value(chart.board, chart[what]) * worth, unit, digits);
    }
    const offset = chart.offset ? model.value(chart.board, chart.offset) : 0;
    if (offset) add("offset", offset * worth, unit, digits);
    put(now, texts.join(" · "));
    set(canvas, "aria-label", `${chart.name}: ${texts.join(", ")}`);
  }

  #draw({ chart, canvas, worth }) {
    const model = this.#model;
    const { context, width, height } = paper(canvas);
    if (!width) return;
    const colours = palette();
    const long = Number(find("motors-window").value);
    const end = Math.max(model.now, long);
    const [begin, now] = [end - long, model.now];
    const course = (name) => (name ? model.course(chart.board, name) : []);
    const [got, drive] = [course(chart.got), course(chart.drive)];
    const asked = chart.asked ? course(chart.asked) : sums(got, course(chart.rest));
    const bottom = height - FOOT - (chart.drive ? DRIVE : 0);
    const x = (at) => LEFT + ((at - begin) / long) * (width - LEFT - RIGHT);

    context.font = FONT;
    context.lineWidth = 1;
    const range = extent([got, asked], begin, worth);
    const y = (value) => bottom - ((value * worth - range[0]) / (range[1] - range[0])) * (bottom - TOP);
    grid(context, colours, { width, range, y: (value) => y(value / worth) });
    for (const mark of ticks(begin, end, Math.max(2, Math.floor(width / 110)))) {
      context.fillStyle = colours.dim;
      context.textAlign = "center";
      const hasRoom = x(mark) > LEFT + 12 && x(mark) < width - 22;
      if (hasRoom) context.fillText(`${Number(mark.toFixed(3))} s`, x(mark), height - 5);
      context.fillStyle = colours.grid;
      context.fillRect(Math.round(x(mark)), TOP, 1, height - FOOT - TOP);
    }
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT - RIGHT, height);
    context.clip();
    steps(context, asked, { begin, now, x, y }, colours.c1, 4, 0.6);
    steps(context, got, { begin, now, x, y }, colours.c0, 1.6, 1);
    context.restore();
    if (chart.drive) strip(context, drive, { begin, end: now, x, top: bottom + 8, bottom: height - FOOT }, colours);
  }
}

/** Where both are known, their sum. */
function sums(got, rest) {
  const found = [];
  let n = 0;
  for (const [at, value] of rest) {
    while (n + 1 < got.length && got[n + 1][0] <= at) n += 1;
    found.push([at, value + (got[n]?.[1] ?? 0)]);
  }
  return found;
}

function extent(courses, begin, worth) {
  let [least, greatest] = [Infinity, -Infinity];
  for (const course of courses) {
    for (let n = Math.max(0, from(course, begin) - 1); n < course.length; n += 1) {
      least = Math.min(least, course[n][1] * worth);
      greatest = Math.max(greatest, course[n][1] * worth);
    }
  }
  if (!(least <= greatest)) return [0, 1];
  const room = Math.max((greatest - least) * 0.08, Math.abs(greatest) * 1e-3, worth * 2, 1e-3);
  return [least - room, greatest + room];
}

function grid(context, colours, { width, range, y }) {
  context.textAlign = "right";
  const marks = ticks(range[0], range[1], 3);
  const digits = Math.max(0, -Math.floor(Math.log10(Math.abs((marks[1] ?? 1) - (marks[0] ?? 0)) || 1) + 1e-9));
  for (const mark of marks) {
    context.fillStyle = colours.grid;
    context.fillRect(LEFT, Math.round(y(mark)), width - LEFT - RIGHT, 1);
    context.fillStyle = colours.dim;
    context.fillText(number(mark, Math.min(digits, 4)), LEFT - 6, y(mark) + 4);
  }
}

/** A course as steps; of what falls into one px, the extremes. */
function steps(context, course, { begin, now, x, y }, colour, wide, opacity) {
  const first = Math.max(0, from(course, begin) - 1);
  if (first >= course.length) return;
  context.beginPath();
  context.moveTo(x(course[first][0]), y(course[first][1]));
  for (let n = first + 1; n < course.length; n += 1) {
    context.lineTo(x(course[n][0]), y(course[n - 1][1]));
    context.lineTo(x(course[n][0]), y(course[n][1]));
  }
  context.lineTo(x(now), y(course[course.length - 1][1]));
  context.strokeStyle = colour;
  context.lineWidth = wide;
  context.lineJoin = "round";
  context.globalAlpha = opacity;
  context.stroke();
  context.globalAlpha = 1;
}

/** The drive: filled from 0, as far as it ever went. */
function strip(context, course, { begin, end, x, top, bottom }, colours) {
  const most = course.reduce((most, [, value]) => Math.max(most, Math.abs(value)), 1);
  const signed = course.some(([, value]) => value < 0);
  const zero = signed ? (top + bottom) / 2 : bottom;
  const reach = zero - top;
  context.fillStyle = colours.grid;
  context.fillRect(LEFT, Math.round(zero), x(end) - LEFT, 1);
  context.fillStyle = colours.c2;
  const first = Math.max(0, from(course, begin) - 1);
  for (let n = first; n < course.length; n += 1) {
    const [left, right] = [Math.max(x(course[n][0]), LEFT), x(course[n + 1]?.[0] ?? end)];
    const high = (course[n][1] / most) * reach;
    if (high) context.fillRect(left, Math.min(zero, zero - high), Math.max(right - left, 0.5), Math.abs(high));
  }
}
