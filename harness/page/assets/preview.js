// What a program would do, drawn before it runs: the lines that the rig has given, in one pair of axes.

import { draw, find, make, set, size } from "./dom.js";
import { ticks } from "./charts.js";
import { number, say } from "./words.js";

/** Room for the scales, in px, and between two of their marks. */
const [LEFT, RIGHT, TOP, FOOT, MARKS] = [48, 16, 10, 42, 70];
/** How high the drawing is at the most where both axes have one scale, and how high where they have not. */
const [HIGHEST, HIGH] = [420, 220];
/** Points that are nearer than this to the one before are not drawn, in px. */
const NEAR = 0.4;

export class Preview {
  known = null;
  #width = null;

  /** Shows what the rig has said of a program; nothing, if there is none. */
  show(known) {
    this.known = known;
    this.#width = null;
    this.draw();
  }

  /** Draws it, if it is new, or if there is another width for it. */
  draw() {
    const place = find("preview");
    const [width] = size(place);
    if (width === this.#width) return;
    this.#width = width;
    place.replaceChildren(...(this.known ? this.#parts(this.known, width) : []));
  }

  #parts({ problems, events, refused, seconds, drawing }, width) {
    const said = events.map(({ event, from_s: from, z_mm: z, worst, unit }) =>
      `${say(`event_${event}`)}: ${from.toFixed(3)} s, z ${number(z, 2)} mm, ${number(worst, 2)} ${unit}`);
    const wrong = [...problems, ...said].map((text) => make("li", {}, text));
    const verdict = refused ? "preview_refused" : seconds === null ? "preview_long" : "preview_takes";
    const parts = [make("p", { class: "readout" }, say(verdict, (seconds ?? 0).toFixed(3)))];
    if (wrong.length) parts.unshift(make("ul", { class: "problems" }, ...wrong));
    if (drawing?.lines.length) {
      const key = ({ name }) => [make("i", { class: way(name) }), make("span", {}, say(`way_${way(name)}`))];
      const keys = drawing.lines.map((line) => make("span", {}, ...key(line)));
      const legend = make("p", { class: "legend ways" }, ...keys);
      parts.push(legend, picture(drawing, Math.max(width, 200)));
    }
    return parts;
  }
}

/** A number on a scale. */
const mark = (value) => String(Number(value.toFixed(3))).replace("-", "\u2212");
const way = (name) => name.replaceAll(" ", "-");

function picture({ x, y, equal, lines }, width) {
  const points = lines.flatMap(({ pieces }) => pieces.flat());
  const ends = (n) => {
    let [least, greatest] = [Infinity, -Infinity];
    for (const point of points) {
      least = Math.min(least, point[n]);
      greatest = Math.max(greatest, point[n]);
    }
    const margin = Math.max(greatest - least, 1e-3) * 0.04;
    return [least - margin, greatest + margin];
  };
  const [[left, right], [low, high]] = [ends(0), ends(1)];
  const across = (width - LEFT - RIGHT) / (right - left);
  const scale = equal ? Math.min(across, (HIGHEST - TOP - FOOT) / (high - low)) : across;
  const up = equal ? scale : (HIGH - TOP - FOOT) / (high - low);
  const height = Math.ceil((high - low) * up + TOP + FOOT);
  const middle = (LEFT + width - RIGHT) / 2;
  const px = (value) => middle + (value - (left + right) / 2) * scale;
  const py = (value) => TOP + (high - value) * up;
  const svg = draw("svg", { role: "img", class: "preview", viewBox: `0 0 ${width} ${height}` });
  set(svg, "aria-label", say("preview_label"));
  const most = (long) => Math.max(2, Math.floor(long / MARKS) + 1);
  svg.append(draw("g", { class: "scale" },
    ...ticks(left, right, most((right - left) * scale)).flatMap((value) => [
      draw("path", { d: `M${px(value).toFixed(1)} ${TOP}V${height - FOOT}` }),
      draw("text", { x: px(value).toFixed(1), y: height - FOOT + 16 }, mark(value)),
    ]),
    ...ticks(low, high, most((high - low) * up)).flatMap((value) => [
      draw("path", { d: `M${px(left).toFixed(1)} ${py(value).toFixed(1)}H${px(right).toFixed(1)}` }),
      draw("text", { x: px(left) - 6, y: py(value) + 4, class: "unit" }, mark(value)),
    ]),
    draw("text", { x: middle, y: height - 6 }, `${x} · ${y}`)));
  for (const { name, pieces } of lines) {
    svg.append(draw("path", { class: `way ${way(name)}`, d: pieces.map((piece) => drawn(piece, px, py)).join("") }));
  }
  return svg;
}

function drawn(piece, px, py) {
  let [d, from] = ["", null];
  for (const [n, [x, y]] of piece.entries()) {
    const at = [px(x), py(y)];
    const isNear = from && Math.hypot(at[0] - from[0], at[1] - from[1]) < NEAR;
    if (isNear && n < piece.length - 1) continue;
    d += `${from ? "L" : "M"}${at[0].toFixed(1)} ${at[1].toFixed(1)}`;
    from = at;
  }
  return d;
}
