// The rig as it was: of what the page was told, the server keeps as much as it has room for.

import { find, put, set } from "./dom.js";
import { instant, number, say } from "./words.js";
import { Model } from "./model.js";
import { ask } from "./controls.js";

const NANO = 1e-9;
const MIB = 2 ** 20;
/** The slider has so many places. */
const PLACES = 500;

/** A model that is now this one, and now another: views read it as one. */
export function facade(first) {
  let current = first;
  const model = new Proxy({}, {
    get: (_, name) => {
      const value = Reflect.get(current, name, current);
      return typeof value === "function" ? value.bind(current) : value;
    },
  });
  return { model, show: (other) => { current = other; } };
}

export class Past {
  #live;
  #show;
  /** When the rig was as it is shown, in s; null while it is shown as it is. */
  #at = null;
  /** When it is to be shown as it was, and whether that is still to be asked for, or the answer is due. */
  #wish = null;
  #wanted = null;
  #asks = false;
  /** What was kept when the rig ended. */
  #last = null;

  /** `show` shows a model in place of the one before. */
  constructor(live, show) {
    this.#live = live;
    this.#show = show;
    find("past-at").addEventListener("input", (event) => this.#go(Number(event.target.value)));
    find("past-live").addEventListener("click", () => this.#return());
  }

  begin() {
    find("past").hidden = false;
  }

  /** The rig has ended: what it was is fetched while it can be. */
  async end() {
    this.#last = await ask({ do: "past", ns: Math.round(this.#live.now / NANO) });
  }

  /** Shows the rig as it was at an instant. While an answer is due, the latest wish counts. */
  async #go(at) {
    this.#wish = at;
    this.#wanted = at;
    if (this.#asks) return;
    this.#asks = true;
    while (this.#wanted !== null) {
      const wanted = this.#wanted;
      this.#wanted = null;
      const told = this.#last ?? await ask({ do: "past", ns: Math.round(wanted / NANO) });
      if (!told) this.#wish = this.#at;
      if (!told || this.#wish === null) break;
      this.#at = wanted;
      this.#show(this.#made(told, wanted));
    }
    this.#asks = false;
  }

  #made({ looks, part }, at) {
    const model = new Model();
    model.begin(this.#live.rig);
    for (const look of looks) if (look.state.ok?.ns * NANO <= at + NANO) model.look(look);
    model.part = part?.ok ?? null;
    model.past = true;
    // Nothing moves there.
    if (model.state) model.state = { ...model.state, paused: true };
    return model;
  }

  #return() {
    this.#wish = null;
    this.#wanted = null;
    this.#at = null;
    this.#show(this.#live);
  }

  draw() {
    const { kept, now } = this.#live;
    const first = this.#last?.looks[0]?.state.ok?.ns ?? kept?.from ?? null;
    const slider = find("past-at");
    slider.disabled = first === null || (this.#live.outcome !== null && !this.#last);
    if (first === null) return;
    const from = first * NANO;
    set(slider, "min", from);
    set(slider, "max", now);
    set(slider, "step", Math.max((now - from) / PLACES, 1e-3));
    if (document.activeElement !== slider || this.#wish === null) slider.value = this.#wish ?? now;
    const shown = instant(this.#at ?? now);
    set(slider, "aria-valuetext", shown);
    put(find("past-time"), say(this.#at === null ? "past_none" : "past_at", shown));
    set(find("past"), "data-is", this.#at === null ? "live" : "past");
    find("past-live").disabled = this.#at === null;
    const mib = (bytes) => number(bytes / MIB, 1);
    put(find("past-kept"), say("past_kept", mib(kept.bytes), number(kept.room / MIB), instant(from, 1)));
  }
}
