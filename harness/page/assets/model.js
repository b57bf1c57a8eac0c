// What is known of the rig: what it consists of, how it is, and what has happened lately.

/** So many points of a quantity are kept. */
const POINTS = 6000;
/** So many characters and messages are kept. */
const ROWS = 6000;
const NANO = 1e-9;

export class Model {
  rig = null;
  state = null;
  part = null;
  /** How the rig has ended, if it has. */
  outcome = null;
  /** Characters and messages on lines, by line: [s, byte, error] and [s, text, flaw]. */
  lines = new Map();
  /** Rows for people: those that are not listed yet, and those that are. */
  fresh = [];
  listed = [];
  /** How much is kept of what was told, and from when on. */
  kept = null;
  /** Whether this is the rig as it was. */
  past = false;
  /** Updates that this browser was too slow for, and rows that were too many to be told. */
  lost = 0;
  leftOut = 0;
  #courses = new Map();
  #boards = new Map();

  begin(rig) {
    this.rig = rig;
    this.state = null;
    this.part = null;
    this.fresh = [];
    this.listed = [];
    this.#courses = new Map();
    this.#boards = new Map(rig.boards.map((board) => [board.name, board]));
    this.lines = new Map(rig.lines.map((line) => [line.name, { characters: [], messages: [], last: -1 }]));
  }

  /** What has happened since the last look, and how the rig is now. */
  look({ state, rows, kept, left_out: leftOut }) {
    if (!this.rig || !state.ok) return;
    this.kept = kept;
    this.leftOut += leftOut;
    for (const row of rows) this.#note(row);
    this.state = state.ok;
    // What no row tells: the speeds of axes, and what was too many rows ago.
    for (const board of this.state.boards) {
      for (const [quantity, value] of Object.entries(board.telemetry)) {
        this.#add(board.name, quantity, this.now, value);
      }
    }
  }

  #note(row) {
    if (row.lost) {
      this.leftOut += row.lost;
      return;
    }
    const at = row.ns * NANO;
    if (row.kind === "telemetry") {
      this.#add(row.board, row.quantity, at, row.value);
    } else if (row.kind === "characters") {
      const line = this.lines.get(row.line);
      keep(line.characters, [at, row.byte, row.error]);
      line.last = at;
    } else {
      if (row.kind === "frames") keep(this.lines.get(row.line).messages, [at, row.text, row.flaw]);
      // What a gateway sends and receives is said on its line, too.
      if (row.kind !== "events" || !this.board(row.board).gateway) keep(this.fresh, row);
    }
  }

  #add(board, quantity, at, value) {
    const key = `${board} ${quantity}`;
    let course = this.#courses.get(key);
    if (!course) this.#courses.set(key, (course = []));
    const last = course[course.length - 1];
    if (last && (last[1] === value || last[0] > at)) return;
    keep(course, [at, value], POINTS);
  }

  /** How far time has gone, in s. */
  get now() {
    return this.state ? this.state.ns * NANO : 0;
  }

  /** Whether nothing can be done to it: this is how it was, or it has ended. */
  get fixed() {
    return this.past || this.outcome !== null;
  }

  /** What a board's quantity was, from each instant on. */
  course(board, quantity) {
    return this.#courses.get(`${board} ${quantity}`) ?? [];
  }

  /** What it is. */
  value(board, quantity) {
    return this.boardState(board)?.telemetry[quantity] ?? 0;
  }

  board(name) {
    return this.#boards.get(name);
  }

  boardState(name) {
    return this.state?.boards.find((board) => board.name === name);
  }

  /** The faults that last at a place: they are called after it, unless somebody has given them a name. */
  faultsAt(place) {
    return (this.state?.faults ?? []).filter((fault) => fault.name === place || fault.name.startsWith(`${place} `));
  }

  /** What a source of the part's says: the sum of quantities, scaled. */
  source({ board, signals, per_count: perCount }) {
    return signals.reduce((sum, signal) => sum + this.value(board, signal), 0) * perCount;
  }
}

function keep(list, item, most = ROWS) {
  list.push(item);
  if (list.length > most * 1.25) list.splice(0, list.length - most);
}

/** Where in a list that is sorted by time the part begins that is not before `at`. */
export function from(list, at) {
  let [low, high] = [0, list.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle][0] < at) low = middle + 1;
    else high = middle;
  }
  return low;
}
