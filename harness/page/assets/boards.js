// The rig as a drawing: boards in columns by their way from the outside, and between them the lines.

import { draw, find, make, pressable, put, set } from "./dom.js";
import { number, instant, plain, say } from "./words.js";
import { Pick, heal } from "./faults.js";

const [WIDTH, ROW, PAD, GAP, ACROSS] = [144, 19, 10, 24, 52];
/** A wheel turns no faster on the page, in degrees a second. */
const FAST = 400;
/** A line is lit for so long after a character, in s of the browser's time. */
const LIT = 0.25;

/** The word for a process that does what it should. */
const RUNS = "runs";

/** The columns: how many links each board is away from the nearest gateway. */
function columns(rig) {
  const depth = new Map(rig.boards.filter((board) => board.gateway).map((board) => [board.name, 0]));
  for (const [name, at] of depth) {
    for (const { from, to } of rig.lines) {
      if (from === name && !depth.has(to)) depth.set(to, at + 1);
    }
  }
  const found = [];
  for (const board of rig.boards) (found[depth.get(board.name) ?? 1] ??= []).push(board);
  return found.filter((column) => column?.length);
}

export class Boards {
  #model;
  #pick;
  #boards = [];
  #lines = [];
  #upright = null;
  #places = new Map();

  constructor(model) {
    this.#model = model;
    this.#pick = new Pick(model);
    // Nothing is made smaller, as words must be read: where there is no room, boards stand below one another.
    new ResizeObserver(() => {
      if (model.rig && this.#upright !== this.#isUpright()) this.begin();
    }).observe(find("rig-drawing").parentElement);
  }

  #isUpright() {
    const found = columns(this.#model.rig).length;
    return find("rig-drawing").parentElement.clientWidth < found * (WIDTH + ACROSS) - ACROSS + 4;
  }

  begin() {
    this.#upright = this.#isUpright();
    this.#boards = [];
    this.#lines = [];
    const picture = find("rig-drawing");
    const places = this.#places = this.#placed();
    const lines = draw("g", { class: "lines" });
    const boards = draw("g");
    for (const [n, line] of this.#model.rig.lines.entries()) lines.append(this.#line(line, n, places));
    for (const place of places.values()) boards.append(this.#board(place));
    picture.replaceChildren(lines, boards);
    const all = [...places.values()];
    const width = Math.max(...all.map(({ x }) => x)) + WIDTH + 2;
    const height = Math.max(...all.map(({ y, height }) => y + height)) + 2;
    set(picture, "viewBox", `0 0 ${width} ${height}`);
    picture.style.width = `${width}px`;
    set(picture, "aria-label", say("boards_and_lines"));
    this.#pick.begin();
  }

  #height(board) {
    const states = board.signals.filter((signal) => signal.role === "State").length;
    return 2 * PAD + ROW * (1 + states) + (board.motors.length ? ROW + 6 : 0);
  }

  /** Where each board is: columns side by side; on a narrow screen, rows below one another, set off by their depth. */
  #placed() {
    const places = new Map();
    const found = columns(this.#model.rig);
    const heights = found.map((column) => column.reduce((sum, board) => sum + this.#height(board) + GAP, -GAP));
    let y = 2;
    for (const [n, column] of found.entries()) {
      let down = this.#upright ? y : 2 + (Math.max(...heights) - heights[n]) / 2;
      for (const board of column) {
        const height = this.#height(board);
        const x = this.#upright ? 2 + Math.min(n, 3) * 56 : 2 + n * (WIDTH + ACROSS);
        places.set(board.name, { board, x, y: down, height });
        down += height + GAP;
      }
      y = down;
    }
    return places;
  }

  #board({ board, x, y, height }) {
    const name = draw("text", { x: x + PAD, y: y + PAD + 11, class: "name" }, board.name);
    const lamp = draw("circle", { cx: x + WIDTH - PAD - 4, cy: y + PAD + 7, r: 4, class: "lamp" });
    const group = draw("g", { class: "board" },
      draw("rect", { x, y, width: WIDTH, height, rx: 7 }), name, lamp);
    const states = board.signals.filter((signal) => signal.role === "State").map((signal, n) => {
      const down = y + PAD + 11 + ROW * (n + 1);
      const value = draw("text", { x: x + WIDTH - PAD, y: down, class: "value" });
      group.append(draw("text", { x: x + PAD, y: down, class: "dim" }, plain(signal.name)), value);
      return { signal, value };
    });
    const kind = say(board.gateway ? "gateway" : "board");
    pressable(group, () => this.#pick.show({ kind: "board", place: board.name, board }));
    const whole = draw("g", {}, group);
    const motors = board.motors.map((motor, n) => {
      const place = board.motors.length > 1 ? `${board.name}.${motor.name}` : board.name;
      const [cx, cy] = [x + PAD + 10 + n * 30, y + height - PAD - 8];
      const spoke = draw("path", { d: `M${cx - 8} ${cy}h16`, class: "spoke" });
      const wheel = draw("g", { class: "motor" }, draw("circle", { cx, cy, r: 10 }), spoke);
      set(wheel, "aria-label", `${say("motor")} ${place}`);
      wheel.append(draw("title", {}, `${say("motor")} ${place}`));
      pressable(wheel, () => this.#pick.show({ kind: "motor", place, board, motor }));
      whole.append(wheel);
      const chart = this.#model.rig.charts.find((chart) => chart.board === board.name && chart.motor === n);
      return { place, chart, spoke, wheel, cx, cy, angle: 0, at: 0 };
    });
    this.#boards.push({ board, kind, group, lamp, states, motors });
    return whole;
  }

  #line(line, n, places) {
    const [from, to] = [places.get(line.from), places.get(line.to)];
    const others = this.#model.rig.lines;
    const onward = n <= others.findIndex((other) => other.from === line.to && other.to === line.from);
    const shift = onward ? -5 : 5;
    const path = this.#upright ? upright(from, to, shift, this.#trunk(from, to)) : sideways(from, to, shift);
    const wire = draw("path", { d: path, class: "wire", "marker-end": "none" });
    const group = draw("g", { class: "line" }, draw("path", { d: path, class: "reach" }), wire,
      arrow(wire), draw("title", {}, plain(line.name)));
    pressable(group, () => this.#pick.show({ kind: "line", place: line.name, line }));
    this.#lines.push({ line, group });
    return group;
  }

  /** Where one board has many links below it, each has a way down of its own; the longest is the leftmost. */
  #trunk(from, to) {
    const [upper, lower] = from.y < to.y ? [from, to] : [to, from];
    const below = this.#model.rig.lines.filter((line) => line.from === upper.board.name).map((line) => line.to)
      .filter((name) => this.#places.get(name).y > upper.y);
    const after = below.length - 1 - below.indexOf(lower.board.name);
    return 12 + after * Math.min(14, 30 / Math.max(below.length - 1, 1));
  }

  draw() {
    const model = this.#model;
    if (!model.state) return;
    for (const { line, group } of this.#lines) {
      const broken = model.faultsAt(line.name).length > 0;
      const lit = model.now - model.lines.get(line.name).last < LIT * pace(model);
      set(group, "data-is", broken ? "broken" : lit ? "lit" : "idle");
      set(group, "aria-label", `${say("line")} ${plain(line.name)}${broken ? `, ${say("broken")}` : ""}`);
    }
    for (const { board, kind, group, lamp, states, motors } of this.#boards) {
      const state = model.boardState(board.name);
      const broken = model.faultsAt(board.name).length > 0 || state.process !== RUNS;
      set(lamp, "data-is", broken ? "broken" : state.waits_for.length ? "waits" : "runs");
      const waits = state.waits_for.length ? `, ${say("waits_for", board.name, state.waits_for.join(", "))}` : "";
      set(group, "aria-label", `${kind} ${board.name}${broken ? `, ${say("broken")}` : ""}${waits}`);
      for (const { signal, value } of states) {
        const now = state.telemetry[signal.name] ?? 0;
        put(value, number(now));
        set(value, "data-on", now !== signal.initial);
      }
      for (const motor of motors) this.#turn(motor);
    }
    this.#words();
    this.#pick.draw();
  }

  /** A wheel turns with its motor: by its position, or as fast as it turns, but not faster than an eye follows. */
  #turn(motor) {
    const { chart, spoke, wheel, cx, cy } = motor;
    const model = this.#model;
    if (chart) {
      const value = model.value(chart.board, chart.got);
      const wall = performance.now() / 1000;
      if (chart.what === "position") motor.angle = value * 4;
      else if (!model.state.paused) motor.angle += Math.max(-FAST, Math.min(FAST, value)) * (wall - motor.at);
      motor.at = wall;
      set(spoke, "transform", `rotate(${(motor.angle % 360).toFixed(0)} ${cx} ${cy})`);
    }
    set(wheel, "data-is", model.faultsAt(motor.place).length ? "broken" : "runs");
  }

  /** Who waits for whom, and which faults last. */
  #words() {
    const { state, rig, fixed } = this.#model;
    const waits = [];
    for (const { name, process, waits_for: others } of state.boards) {
      const gateway = this.#model.board(name)?.gateway;
      if (process !== RUNS) waits.push(["bad", say("process_is", name, process)]);
      if (!others.length) continue;
      const chain = others.map((other) => state.boards.find((board) => board.name === other))
        .filter((board) => board?.waits_for.length)
        .map((board) => say("waits_for", board.name, board.waits_for.join(", ")));
      const why = chain.length ? chain.join("; ") : say("waits_for", name, others.join(", "));
      waits.push(["", gateway ? say("pc_held", name, why) : say("waits_for", name, others.join(", "))]);
    }
    if (!waits.length) waits.push(["dim", say("nobody_waits")]);
    const key = JSON.stringify([waits, state.faults, fixed, rig.rig]);
    if (key === this.#said) return;
    this.#said = key;
    find("waits").replaceChildren(...waits.map(([style, text]) => make("p", { class: style }, text)));
    const faults = state.faults.map((fault) => {
      const since = fault.since === null ? say("lies_in_wait") : say("since", instant(fault.since * 1e-9));
      const until = fault.until === null ? "" : `, ${say("until", instant(fault.until * 1e-9))}`;
      const button = make("button", { type: "button", disabled: fixed, onclick: () => heal(fault.name) }, say("heal"));
      button.setAttribute("aria-label", `${say("heal")}: ${fault.name}`);
      return make("li", {}, make("span", {}, make("b", {}, plain(fault.name)), ` ${since}${until}`), button);
    });
    const title = make("h3", {}, say("faults"));
    find("faults").replaceChildren(title, faults.length ? make("ul", { class: "faults" }, ...faults)
      : make("p", { class: "dim" }, say("no_faults")));
  }

  #said = "";
}

const pace = (model) => (model.state.pace === "max" ? 10 : Math.max(Number(model.state.pace), 0.2));

function sideways(from, to, shift) {
  const right = from.x < to.x;
  const [x1, x2] = right ? [from.x + WIDTH, to.x - 1] : [from.x, to.x + WIDTH + 1];
  const middle = ({ y, height }) => y + height / 2;
  // Where one board has many links, they leave it at different heights.
  const lean = (one, other) => {
    const most = one.height / 2 - 12;
    return Math.max(-most, Math.min(most, (middle(other) - middle(one)) * 0.16));
  };
  const y1 = middle(from) + lean(from, to) + shift;
  const y2 = middle(to) + lean(to, from) + shift;
  const bend = (x1 + x2) / 2;
  return `M${x1} ${y1}C${bend} ${y1} ${bend} ${y2} ${x2} ${y2}`;
}

function upright(from, to, shift, trunk) {
  const down = from.y < to.y;
  const [upper, lower] = down ? [from, to] : [to, from];
  const x = upper.x + trunk + shift;
  const y = lower.y + lower.height / 2 + shift;
  const [bottom, left] = [upper.y + upper.height, lower.x];
  return down ? `M${x} ${bottom}V${y}H${left - 1}` : `M${left} ${y}H${x}V${bottom + 1}`;
}

/** The head of an arrow at a path's end. */
function arrow(wire) {
  const length = wire.getTotalLength();
  const [end, before] = [wire.getPointAtLength(length), wire.getPointAtLength(Math.max(0, length - 4))];
  const angle = (Math.atan2(end.y - before.y, end.x - before.x) * 180) / Math.PI;
  const transform = `translate(${end.x} ${end.y}) rotate(${angle})`;
  return draw("path", { d: "M0 0L-7 -3.5V3.5Z", class: "head", transform });
}
