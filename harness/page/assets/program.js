// A program for the rig: loaded from a file or typed, started, stopped.

import { find, put } from "./dom.js";
import { say } from "./words.js";
import { ask, tell } from "./controls.js";

export class Program {
  #model;

  constructor(model) {
    this.#model = model;
    find("program-open").addEventListener("click", () => find("program-file").click());
    find("program-file").addEventListener("change", async (event) => {
      const [file] = event.target.files;
      if (file) find("program-text").value = await file.text();
    });
    find("program-start").addEventListener("click", () => {
      const program = find("program-text").value;
      if (program.trim()) ask({ do: "play", program });
      else tell(say("none_yet"));
    });
    find("program-stop").addEventListener("click", () => ask({ do: "stop" }));
  }

  begin() {
    find("program").hidden = !this.#model.rig.plays;
  }

  draw() {
    const program = this.#model.state?.program;
    if (!program) return;
    const { accepted, of, outcome } = program;
    put(find("program-state"), outcome ? say("program_ended", outcome) : say("program_runs", accepted, of));
  }
}
