// Which language the page speaks, and how it says numbers.

import { LANGUAGES, TEXTS } from "./texts.js";
import { find, fill } from "./dom.js";

const KEY = "torno-language";

function remembered() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

const codes = Object.keys(LANGUAGES);
const wanted = [remembered(), ...navigator.languages.map((language) => language.slice(0, 2))];
let place = Math.max(0, codes.indexOf(wanted.find((code) => codes.includes(code)) ?? "en"));

/** A text in the language of the page; `{}` in it stands for the values, in order. */
export function say(key, ...values) {
  const text = TEXTS[key]?.[place] ?? TEXTS[key]?.[0] ?? key;
  return values.reduce((text, value) => text.replace("{}", value), text);
}

/** Puts the texts of the page's own elements, and lets `others` put theirs, now and in any other language. */
export function speak(others) {
  const all = () => {
    document.documentElement.lang = codes[place];
    for (const element of document.querySelectorAll("[data-text]")) element.textContent = say(element.dataset.text);
    for (const element of document.querySelectorAll("[data-label]")) {
      element.setAttribute("aria-label", say(element.dataset.label));
    }
    others();
  };
  const select = find("language");
  fill(select, codes, (code) => LANGUAGES[code], codes[place]);
  select.addEventListener("change", () => {
    place = codes.indexOf(select.value);
    try {
      localStorage.setItem(KEY, select.value);
    } catch {
      // It is not remembered.
    }
    all();
  });
  all();
}

/** A number with so many digits behind the point: never -0, and a real minus. */
export function number(value, digits = 0) {
  const text = Math.abs(value).toFixed(digits);
  return (value < 0 && Number(text) !== 0 ? "\u2212" : "") + text;
}

/** An instant. */
export function instant(seconds, digits = 3) {
  const minutes = Math.floor(seconds / 60);
  if (minutes < 1) return `${seconds.toFixed(digits)} s`;
  const rest = (seconds - 60 * minutes).toFixed(digits);
  const padded = rest.padStart(3 + digits, "0");
  if (minutes < 60) return `${minutes}:${padded}`;
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${padded}`;
}

/** A name of the rig's, for people. */
export const plain = (name) => name.replaceAll("_", " ");

/** A pace. */
export const paceText = (pace) => (pace === "max" ? say("pace_max") : `${pace}\u00d7`);
