// What has been picked in the drawing: it is broken and healed here, in the words of scenario files.

import { fill, find, make, set } from "./dom.js";
import { plain, say } from "./words.js";
import { ask } from "./controls.js";

export const heal = (name) => ask({ do: "heal", name });

/** A table of TOML: texts are written as JSON writes them, numbers as they are. */
function toml(fields) {
  const value = (text) => (/^-?\d+$/.test(text) ? text : JSON.stringify(text));
  return Object.entries(fields).map(([name, text]) => `${name} = ${value(text)}\n`).join("");
}

export class Pick {
  #model;
  #picked = null;
  #state = "";

  constructor(model) {
    this.#model = model;
  }

  begin() {
    if (this.#picked) this.show(this.#picked);
  }

  /** Shows what can be done to a line, a board or a motor. */
  show(picked) {
    this.#picked = picked;
    this.#state = "";
    const panel = find("pick");
    panel.hidden = false;
    const title = make("h3", { tabindex: "-1" }, `${say(picked.kind)} ${plain(picked.place)}`);
    const close = make("button", { type: "button", onclick: () => this.#close() }, say("close"));
    const kinds = this.#kinds();
    panel.replaceChildren(make("div", { class: "title" }, title, close), make("div", { class: "row", id: "pick-now" }));
    if (kinds.length) panel.append(this.#form(kinds));
    title.focus({ preventScroll: true });
    this.draw();
  }

  #close() {
    this.#picked = null;
    find("pick").hidden = true;
  }

  /** The faults that mean something to what is picked. */
  #kinds() {
    const { kind, board, motor } = this.#picked;
    const can = (needs) => !needs || motor?.capabilities.includes(needs) || board?.capabilities.includes(needs);
    return this.#model.rig.faults.filter((fault) => {
      if (kind === "line") return fault.line;
      const ofMotor = ["Motor", "Axis", "Stepper"].includes(fault.needs);
      return !fault.line && !board.gateway && can(fault.needs) && (kind === "motor") === ofMotor;
    });
  }

  #form(kinds) {
    const { kind, place } = this.#picked;
    const select = make("select", { "aria-label": say("fault") });
    fill(select, kinds.map((fault) => fault.kind), (kind) => kind, kinds[0].kind);
    const fields = make("span", { class: "row" });
    const lasts = make("input", { size: 8, placeholder: say("for_ever"), "aria-label": say("for") });
    const inputs = new Map();
    const ready = () => {
      inputs.clear();
      const { fields: named } = kinds.find((fault) => fault.kind === select.value);
      fields.replaceChildren(...named.map(([name, example]) => {
        const input = this.#input(name, String(example));
        inputs.set(name, input);
        return make("label", { class: "pair" }, name, " ", input);
      }));
    };
    select.addEventListener("change", ready);
    ready();
    const act = (event) => {
      event.preventDefault();
      const fault = { [kind === "line" ? "line" : "board"]: place, kind: select.value };
      for (const [name, input] of inputs) if (input.value) fault[name] = input.value;
      if (lasts.value) fault.for = lasts.value;
      ask({ do: "fault", fault: toml(fault) });
    };
    return make("form", { class: "row", onsubmit: act }, select, fields,
      make("label", { class: "pair" }, say("for"), " ", lasts),
      make("button", { class: "danger", id: "break" }, say("break")));
  }

  /** Where a fault needs another line, one of the others; elsewhere an example. */
  #input(name, example) {
    if (name !== "with") return make("input", { size: 8, value: example, "aria-label": name });
    const others = this.#model.rig.lines.map((line) => line.name).filter((line) => line !== this.#picked.place);
    const select = make("select", { "aria-label": name });
    fill(select, others, plain, others[0]);
    return select;
  }

  /** What lasts there now, and its supply. */
  draw() {
    if (!this.#picked) return;
    const { kind, place } = this.#picked;
    const faults = this.#model.faultsAt(place);
    const { fixed } = this.#model;
    const state = JSON.stringify([fixed, faults.map((fault) => fault.name)]);
    if (state === this.#state) return;
    this.#state = state;
    const buttons = faults.map((fault) =>
      make("button", { type: "button", onclick: () => heal(fault.name) }, `${say("heal")}: ${plain(fault.name)}`));
    if (kind === "board") {
      for (const on of [true, false]) {
        const press = () => ask({ do: "power", board: place, on });
        buttons.push(make("button", { type: "button", onclick: press }, say(on ? "power_on" : "power_off")));
      }
    }
    find("pick-now").replaceChildren(...buttons);
    for (const button of find("pick").querySelectorAll("#pick-now button, #break")) button.disabled = fixed;
    set(find("pick"), "data-is", faults.length ? "broken" : "whole");
  }
}
