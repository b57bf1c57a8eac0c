// The rig's time: it is shown, stopped and set going. Whatever is asked goes the same way.

import { fill, find, put } from "./dom.js";
import { instant, paceText, say } from "./words.js";

const PACES = ["0.1", "0.5", "1", "2", "5", "10", "100", "max"];
const STEPS = ["1 ms", "10 ms", "100 ms", "1 s", "10 s"];

/** Sends a request. Gives the response, and the answer in it; none, if it is a file. */
export async function request(asked) {
  try {
    const response = await fetch("ask", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify(asked),
    });
    if (response.headers.has("content-disposition")) return { response };
    const text = await response.text();
    return { response, answer: response.ok ? JSON.parse(text) : { error: text } };
  } catch {
    return { answer: { error: say("unreachable") } };
  }
}

/** Asks the rig for something, as `torno ctl` does. Gives its answer; what it refuses is told, and gives null. */
export async function ask(asked) {
  const { answer } = await request(asked);
  tell(answer.error ?? "");
  return answer.ok ?? null;
}

/** Tells something that went wrong; an empty text takes it away. */
export function tell(text) {
  put(find("alert"), text);
  find("alert").hidden = !text;
}

export class Controls {
  #model;

  constructor(model) {
    this.#model = model;
    find("pause").addEventListener("click", () => ask({ do: model.state?.paused ? "resume" : "pause" }));
    find("step").addEventListener("click", () => ask({ do: "step", span: find("step-by").value }));
    find("set-pace").addEventListener("change", (event) => ask({ do: "pace", pace: event.target.value }));
    find("controls").addEventListener("submit", (event) => event.preventDefault());
    fill(find("step-by"), STEPS, (step) => step, "100 ms");
  }

  begin() {
    fill(find("set-pace"), PACES, paceText, "1");
  }

  draw() {
    const { state, now } = this.#model;
    if (!state) return;
    put(find("time"), instant(now));
    find("still").hidden = !state.paused;
    for (const control of find("controls").elements) control.disabled = this.#model.outcome !== null;
    put(find("pause"), say(state.paused ? "resume" : "pause"));
    const select = find("set-pace");
    if (document.activeElement === select) return;
    if (![...select.options].some((option) => option.value === state.pace)) {
      select.append(new Option(paceText(state.pace), state.pace));
    }
    if (select.value !== state.pace) select.value = state.pace;
  }
}
