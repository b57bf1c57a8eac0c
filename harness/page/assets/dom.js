// Elements, made and found.

const SVG = "http://www.w3.org/2000/svg";

export const find = (id) => document.getElementById(id);

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== undefined && value !== null) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** An element of HTML. */
export const make = (name, attributes = {}, ...children) => filled(document.createElement(name), attributes, children);

/** An element of SVG. */
export const draw = (name, attributes = {}, ...children) =>
  filled(document.createElementNS(SVG, name), attributes, children);

/** Sets a text, if it is another: what stays the same is not laid out again. */
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Sets an attribute, if it is another. */
export function set(element, name, value) {
  const text = String(value);
  if (element.getAttribute(name) !== text) element.setAttribute(name, text);
}

/** A select of values and their texts; `text` shows them again in another language. */
export function fill(select, values, text, chosen) {
  const value = select.value || chosen;
  select.replaceChildren(...values.map((value) => make("option", { value }, text(value))));
  select.value = value;
}

/** Makes a drawn thing a button, for the mouse, the keyboard and screen readers. */
export function pressable(element, press) {
  element.setAttribute("tabindex", "0");
  element.setAttribute("role", "button");
  element.addEventListener("click", press);
  element.addEventListener("keydown", (event) => {
    if (event.key === "Enter" || event.key === " ") {
      event.preventDefault();
      press(event);
    }
  });
  return element;
}

/** What sizes elements have, as the browser has last said: to ask it lays the page out again. */
const sizes = new WeakMap();
const watching = new ResizeObserver((changes) => {
  for (const { target, contentRect: { width, height } } of changes) {
    sizes.set(target, [Math.round(width), Math.round(height)]);
  }
  // Whoever draws by a size draws again.
  dispatchEvent(new Event("resize"));
});

/** The width and the height of an element without padding, in px. */
export function size(element) {
  if (!sizes.has(element)) {
    sizes.set(element, [element.clientWidth, element.clientHeight]);
    watching.observe(element);
  }
  return sizes.get(element);
}

/** A canvas that is as sharp as the screen, with what is on it, unless its size has changed: its context, its width and
 * its height in px of the page. */
export function sized(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = size(canvas);
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  const changed = canvas.width !== w || canvas.height !== h;
  if (changed) Object.assign(canvas, { width: w, height: h });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height, changed };
}

/** The same, with nothing on it. */
export function paper(canvas) {
  const { context, width, height } = sized(canvas);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

let colours = null;
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colours = null; });

/** The page's colours, for a canvas. */
export function palette() {
  if (!colours) {
    const style = getComputedStyle(document.documentElement);
    const names = ["paper", "ink", "dim", "grid", "edge", "c0", "c1", "c2", "on", "bad", "good"];
    colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  return colours;
}

export const FONT = '12px Inter, "Helvetica Neue", Helvetica, Arial, "Liberation Sans", "Noto Sans CJK SC", sans-serif';
