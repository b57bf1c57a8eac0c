// What has happened so far, as files: a recording, a report, the part, the lines, the path.

import { find, make, put } from "./dom.js";
import { number, say } from "./words.js";
import { request, tell } from "./controls.js";

const MIB = 1 << 20;
/** A file that a browser has been given is forgotten after so many ms. */
const HELD = 60000;

export class Save {
  #model;

  constructor(model) {
    this.#model = model;
  }

  begin() {
    const button = (what) => make("button", { type: "button", onclick: (event) => save(what, event.target) },
      say(`save_${what}`));
    find("save-what").replaceChildren(...this.#model.rig.saves.map(button));
  }

  draw() {
    const { kept } = this.#model.state ?? {};
    // What has ended gives nothing more.
    find("save").hidden = !kept || this.#model.fixed;
    if (!kept) return;
    const size = say("kept", number(kept.bytes / MIB, 1), number(kept.of / MIB));
    const until = kept.until === null ? "" : say("kept_until", (kept.until * 1e-9).toFixed(3));
    put(find("kept"), `${size} ${until}`.trim());
  }
}

/** Asks for a file, and hands it to the browser. */
async function save(what, button) {
  button.disabled = true;
  const { response, answer } = await request({ do: "save", what });
  button.disabled = false;
  if (answer) {
    tell(answer.error ?? "");
    return;
  }
  const [, name] = /filename="([^"]*)"/.exec(response.headers.get("content-disposition")) ?? [];
  let file;
  try {
    file = await response.blob();
  } catch {
    tell(say("unreachable"));
    return;
  }
  const url = URL.createObjectURL(file);
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), HELD);
  tell("");
}
