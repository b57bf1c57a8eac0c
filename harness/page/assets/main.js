// The page: it listens to the rig, and lets each view draw what is new, once a frame at the most.

import { find, put } from "./dom.js";
import { Model } from "./model.js";
import { say, speak } from "./words.js";
import { Boards } from "./boards.js";
import { Bus } from "./bus.js";
import { Charts } from "./charts.js";
import { Controls } from "./controls.js";
import { Machine } from "./machine.js";
import { Past, facade } from "./past.js";
import { Program } from "./program.js";
import { Save } from "./save.js";
import { Status } from "./status.js";
import { Talk } from "./talk.js";

/** Numbers for people change a few times a second: so many ms later, the last ones are shown. */
const AT_REST = 300;
/** A server that refuses is asked again after so many ms. */
const AGAIN = 2000;
/** A rig of which nothing has come for so many ms is lost. */
const SILENT = 4000;

const model = new Model();
/** What is shown of the rig: as it is, or as it was. */
const shown = facade(model);
const past = new Past(model, (other) => {
  shown.show(other);
  for (const view of views) view.turn?.();
  show();
});
const views = [
  new Controls(model), new Machine(shown.model), new Boards(shown.model), new Charts(shown.model),
  new Bus(shown.model), new Talk(shown.model), new Program(model), new Save(model), new Status(shown.model), past,
];

let link = "connecting";
let due = false;

/** The next frame shows what is known by then. */
function show() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    performance.mark("torno-frame-begin");
    put(find("link"), how());
    find("link").dataset.link = link;
    if (model.rig) for (const view of views) view.draw();
    performance.measure("torno-frame", "torno-frame-begin");
  });
}

/** How the page stands to the rig, and how that has ended: of one that was up there is nothing to be said. */
function how() {
  const { outcome } = model;
  return outcome && outcome !== "ended" ? say("program_ended", outcome) : say(`link_${link}`);
}

let silence = 0;

function heard() {
  link = "live";
  clearTimeout(silence);
  silence = setTimeout(() => {
    link = "lost";
    show();
  }, SILENT);
}

function listen() {
  const source = new EventSource("events");
  const take = (kind, act) => source.addEventListener(kind, (event) => {
    heard();
    act(JSON.parse(event.data));
    show();
  });
  take("rig", (rig) => {
    model.begin(rig);
    document.title = `${rig.rig} \u2013 torno`;
    put(find("rig-name"), rig.rig);
    for (const view of views) view.begin();
  });
  take("look", (look) => model.look(look));
  take("part", (part) => { model.part = part.ok ?? null; });
  take("lost", (lost) => { model.lost += lost; });
  take("end", ({ outcome }) => {
    model.outcome = outcome;
    link = "ended";
    clearTimeout(silence);
    source.close();
    past.end().then(show);
    setTimeout(show, AT_REST);
  });
  source.addEventListener("error", () => {
    link = "lost";
    show();
    if (source.readyState === EventSource.CLOSED) setTimeout(listen, AGAIN);
  });
}

speak(() => {
  if (model.rig) for (const view of views) view.begin();
  show();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
addEventListener("resize", show);
listen();
