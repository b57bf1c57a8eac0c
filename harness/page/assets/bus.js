// The lines as a logic analyser shows them: every character as long as it takes, and above it what is said.

import { FONT, fill, find, palette, paper, set } from "./dom.js";
import { from } from "./model.js";
import { plain, say } from "./words.js";

/** How much of virtual time is shown, in s. */
const WINDOWS = ["0.05", "0.2", "1", "5", "20"];
const [LANE, TOP, RIGHT] = [44, 20, 8];
/** The bits of a character, and how many of them are over when it is told: in the middle of its stop bit. */
const [BITS, TOLD] = [10, 9.5];

const windowText = (seconds) => (Number(seconds) < 1 ? `${1000 * seconds} ms` : `${seconds} s`);

export class Bus {
  #model;

  constructor(model) {
    this.#model = model;
    fill(find("bus-window"), WINDOWS, windowText, "1");
  }

  begin() {
    find("lanes").style.height = `${TOP + LANE * this.#model.rig.lines.length + 4}px`;
  }

  draw() {
    const model = this.#model;
    const canvas = find("lanes");
    const { context, width } = paper(canvas);
    if (!width || !model.state) return;
    const chosen = find("bus-window").value;
    set(canvas, "aria-label", say("bus_label", model.rig.lines.length, windowText(chosen)));
    const long = Number(chosen);
    const narrow = width < 520;
    const left = narrow ? 8 : 170;
    const end = Math.max(model.now, long);
    const view = { begin: end - long, end, left, right: width - RIGHT, scale: (width - RIGHT - left) / long, narrow };
    const colours = palette();
    context.font = FONT;
    this.#time(context, colours, view);
    for (const [n, line] of model.rig.lines.entries()) {
      this.#lane(context, colours, { ...view, line, y: TOP + LANE * n });
    }
  }

  #time(context, colours, { begin, end, left, right, scale }) {
    context.fillStyle = colours.dim;
    context.textAlign = "left";
    context.fillText(`${begin.toFixed(3)} s`, left, 13);
    context.textAlign = "right";
    context.fillText(`${end.toFixed(3)} s`, right, 13);
    context.fillStyle = colours.grid;
    for (let n = 0; n <= 10; n += 1) context.fillRect(Math.round(left + (n / 10) * (end - begin) * scale), TOP, 1, 1e4);
  }

  #lane(context, colours, { line, y, begin, left, right, scale, narrow }) {
    const known = this.#model.lines.get(line.name);
    const x = (at) => left + (at - begin) * scale;
    const [high, low] = [y + 20, y + LANE - 8];
    context.textAlign = "left";
    context.fillStyle = colours.dim;
    if (!narrow) context.fillText(plain(line.name), 0, (high + low) / 2 + 4, left - 10);
    const broken = this.#model.faultsAt(line.name).length > 0;
    context.fillStyle = broken ? colours.bad : colours.edge;
    context.fillRect(left, high, right - left, 1);
    context.save();
    context.beginPath();
    context.rect(left, y, right - left, LANE);
    context.clip();
    const wide = (BITS / line.baud) * scale;
    const list = known.characters;
    let drawn = -1;
    for (let n = from(list, begin); n < list.length; n += 1) {
      const [at, byte, error] = list[n];
      const begun = x(at - TOLD / line.baud);
      // What would cover what is there already is left out.
      if (begun + wide < drawn + 0.5 && !error) continue;
      drawn = begun + wide;
      context.fillStyle = error ? colours.bad : colours.c0;
      context.globalAlpha = 0.28;
      context.fillRect(begun, high, Math.max(wide, 1), low - high);
      context.globalAlpha = 1;
      context.fillRect(begun, high, 1, low - high);
      if (wide > 18) {
        context.fillStyle = colours.ink;
        context.fillText(byte.toString(16).toUpperCase().padStart(2, "0"), begun + 4, low - 4);
      }
    }
    this.#messages(context, colours, known.messages, { begin, x, y, left, line, narrow });
    context.restore();
  }

  /** What is said stands before its end; what has no room there is left out, the latest first. */
  #messages(context, colours, list, { begin, x, y, left, line, narrow }) {
    context.textAlign = "left";
    let room = Infinity;
    for (let n = list.length - 1; n >= 0 && list[n][0] >= begin; n -= 1) {
      const [at, text, flaw] = list[n];
      const long = context.measureText(text).width;
      const start = Math.max(x(at) - long, left + 2);
      if (start + long > room) continue;
      room = start - 10;
      context.fillStyle = flaw ? colours.bad : colours.ink;
      context.fillText(text, start, y + 15);
    }
    // On a narrow screen a line has its name where nothing is said.
    if (!narrow || left + context.measureText(plain(line.name)).width > room) return;
    context.fillStyle = colours.dim;
    context.fillText(plain(line.name), left + 2, y + 15);
  }
}
