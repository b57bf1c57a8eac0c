// A program for the rig: loaded from a file or typed, drawn, started, stopped.

import { find, put } from "./dom.js";
import { say } from "./words.js";
import { ask, request, tell } from "./controls.js";
import { Preview } from "./preview.js";

/** So many ms after the last letter it is drawn. */
const TYPED = 500;

export class Program {
  #model;
  #preview = new Preview();
  #typed = 0;
  /** The text that is drawn, or is about to be. */
  #text = "";

  constructor(model) {
    this.#model = model;
    find("program-open").addEventListener("click", () => find("program-file").click());
    find("program-file").addEventListener("change", async (event) => {
      const [file] = event.target.files;
      if (!file) return;
      find("program-text").value = await file.text();
      // The same file again is a change, too.
      event.target.value = "";
      this.#look();
    });
    find("program-text").addEventListener("input", () => {
      clearTimeout(this.#typed);
      this.#typed = setTimeout(() => this.#look(), TYPED);
    });
    find("program-start").addEventListener("click", () => {
      const program = find("program-text").value;
      if (program.trim()) ask({ do: "play", program });
      else tell(say("none_yet"));
    });
    find("program-stop").addEventListener("click", () => ask({ do: "stop" }));
  }

  begin() {
    const { plays, player } = this.#model.rig;
    find("program").hidden = !plays && !player;
    for (const button of ["program-start", "program-stop"]) find(button).hidden = !plays;
    if (!plays) put(find("program-hint"), say("program_elsewhere", player));
    const known = this.#preview;
    known.show(known.known);
  }

  /** Lets the rig look at the program, and draws what it says; of several, the last. */
  async #look() {
    const program = find("program-text").value;
    if (program === this.#text) return;
    this.#text = program;
    if (!program.trim()) {
      this.#preview.show(null);
      return;
    }
    put(find("preview-state"), say("preview_begins"));
    const { answer } = await request({ do: "preview", program });
    if (program !== this.#text) return;
    put(find("preview-state"), answer.error ?? "");
    this.#preview.show(answer.ok ?? null);
  }

  draw() {
    this.#preview.draw();
    for (const button of ["program-open", "program-start", "program-stop"]) find(button).disabled = this.#model.fixed;
    const program = this.#model.state?.program;
    if (!program) return;
    const { accepted, of, outcome } = program;
    // What a run plays is not chosen here.
    const place = find(this.#model.rig.plays ? "program-state" : "progress");
    put(place, outcome ? say("program_ended", outcome) : say("program_runs", accepted, of));
  }
}
