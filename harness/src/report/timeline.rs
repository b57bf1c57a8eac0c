//! The bus as a timeline: who sent what when, when the PC was held, which boards were waited for.
//!
//! Where a rig's dialect is known, what stands there are its messages; else, the characters.

use std::fmt::Write;

use torno_plot::{Chart, ChartRow, escaped};
use torno_protocol::time::Instant;

use super::series::{Course, Courses, lasting};
use torno_bus::STOPPED;
use torno_engine::LineId;
use torno_protocol::layout::{Layout, LineLayout};
use torno_trace::Trace;
use torno_trace::analyser::rows;
use torno_trace::rows::{Filter, Kind, RowPlace, Wanted};

/// More marks than this are not drawn, in all lanes together: those of a column become one.
const MOST: u64 = 8_000;
/// So many texts of a column are told.
const TOLD: usize = 8;
/// The kind of a message has so many words at the most.
const WORDS: usize = 4;
/// The name of the state in which `XOFF` holds the PC.
pub(super) const PC_HELD: &str = "PC held";
/// A silence of so many seconds ends what is shown close up; no more than so many are.
const SILENCE: f64 = 0.010;
const LONGEST: f64 = 0.050;

/// Something on a line.
#[derive(Clone, Debug)]
pub(super) struct BusMessage {
    /// When it was complete.
    pub(super) at: Instant,
    /// Where.
    pub(super) line: LineId,
    /// What.
    pub(super) text: String,
    /// Something is wrong with it.
    pub(super) flaw: bool,
}

impl BusMessage {
    /// How it looks: words with something to say, single words of control, what is wrong.
    fn class(&self) -> &'static str {
        match self.text.chars().next() {
            _ if self.flaw => "flaw",
            Some(first) if first.is_lowercase() => "message",
            _ => "control",
        }
    }

    /// What kind of message it is: the words before a colon or a number, or the first one.
    pub(super) fn kind(&self) -> &str {
        let head = self.text.split(':').next().unwrap_or_default();
        let is_number = |word: &&str| word.contains(|c: char| c.is_ascii_digit());
        let length = head.split(' ').take(WORDS).take_while(|word| !is_number(word)).map(|word| word.len() + 1).sum();
        let first = || head.split(' ').next().unwrap_or_default();
        head.get(..usize::saturating_sub(length, 1)).filter(|kind| !kind.is_empty()).unwrap_or_else(first)
    }
}

/// A state that comes and goes.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// What it is.
    pub(super) name: String,
    /// The boards whose link it belongs to.
    of: (usize, usize),
    /// From when to when.
    pub(super) spans: Vec<(Instant, Instant)>,
}

impl State {
    fn new(name: String, of: (usize, usize), course: &Course, until: Instant, bit: u32) -> Self {
        let mut spans: Vec<(Instant, Instant)> = Vec::new();
        let ends = course.iter().skip(1).map(|(at, _)| *at).chain([until]);
        for ((at, value), end) in course.iter().zip(ends) {
            match spans.last_mut() {
                _ if value.checked_shr(bit).unwrap_or_default() & 1 == 0 => {}
                Some(last) if last.1 == *at => last.1 = end,
                _ => spans.push((*at, end)),
            }
        }
        spans.retain(|(from, to)| from < to);
        Self { name, of, spans }
    }

    /// How long it was so, in seconds.
    pub(super) fn seconds(&self) -> f64 {
        self.spans.iter().fold(0.0, |sum, (from, to)| sum + to.since(*from).as_secs_f64())
    }
}

/// The lines of a rig, and what was on them.
pub(super) struct Bus<'a> {
    layout: &'a Layout,
    until: Instant,
    /// The lines, link by link, the PC's first.
    pub(super) lines: Vec<LineId>,
    /// The characters, in order of time.
    pub(super) characters: Vec<BusMessage>,
    /// The messages, in order of time.
    pub(super) messages: Vec<BusMessage>,
    /// What was done to the rig from outside.
    pub(super) inputs: Vec<(Instant, String)>,
    /// What was on and off.
    pub(super) states: Vec<State>,
}

impl<'a> Bus<'a> {
    /// What was said in a trace.
    pub(super) fn new(trace: &'a Trace, courses: &Courses) -> Self {
        let (header, layout) = (&trace.header, &trace.header.layout);
        let kinds = ["characters", "frames", "inputs"].map(str::to_owned).to_vec();
        let rows = Filter::new(header, &Wanted { kinds, ..Wanted::default() })
            .map_or_else(|_| Vec::new(), |filter| rows(trace, &filter, torno_machines::dialect));
        let (mut characters, mut messages, mut inputs) = (Vec::new(), Vec::new(), Vec::new());
        for row in rows {
            let (at, text, flaw) = (row.at, row.what(), row.is_flaw());
            match (row.place, row.kind()) {
                (RowPlace::Line(line), Kind::Characters) => characters.push(BusMessage { at, line, text, flaw }),
                (RowPlace::Line(line), Kind::Frames) => messages.push(BusMessage { at, line, text, flaw }),
                // What the PC writes is on its line.
                (RowPlace::Board(board), Kind::Inputs) if layout.boards[board].is_gateway() => {}
                (place, Kind::Inputs) => inputs.push((at, format!("{}: {text}", place.name(header)))),
                _ => {}
            }
        }
        let mut lines: Vec<LineId> = (0..layout.lines.len()).collect();
        let place = |link: (usize, usize)| layout.lines.iter().position(|line| ends(line) == link);
        lines.sort_by_key(|number| {
            let line = &layout.lines[*number];
            (!layout.is_outside(line), place(ends(line)), *number)
        });
        let until = trace.until();
        let states = states(trace, courses, until);
        Self { layout, until, lines, characters, messages, inputs, states }
    }

    /// The name of a line: from whom to whom.
    pub(super) fn name(&self, line: LineId) -> String {
        let line = &self.layout.lines[line];
        let name = |(board, _): (usize, u8)| self.layout.boards[board].name.as_str();
        format!("{} → {}", name(line.from), name(line.to))
    }

    /// What is to be shown of a line: its messages, or its characters, if nobody understands them.
    pub(super) fn said(&self, line: LineId) -> Vec<&BusMessage> {
        let messages: Vec<&BusMessage> = self.messages.iter().filter(|said| said.line == line).collect();
        if messages.is_empty() { self.characters.iter().filter(|said| said.line == line).collect() } else { messages }
    }

    /// The time of a character on a line, in seconds: the shortest from one to the next, anywhere if there is but one.
    pub(super) fn character_s(&self, line: LineId) -> f64 {
        let shortest = |line: LineId| {
            let on: Vec<f64> =
                self.characters.iter().filter(|said| said.line == line).map(|said| said.at.as_secs_f64()).collect();
            on.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > 0.0).fold(f64::MAX, f64::min)
        };
        let anywhere = self.lines.iter().map(|line| shortest(*line)).fold(f64::MAX, f64::min);
        // A line with silences only says nothing of its characters.
        let own = shortest(line);
        let found = if own < 1.5 * anywhere { own } else { anywhere };
        if found < 1.0 { found } else { 0.0 }
    }

    /// All of it, over the whole time.
    pub(super) fn chart(&self) -> Chart {
        let mut rows = Vec::new();
        let columns = (MOST / self.lines.len().max(1) as u64).min(u64::from(ChartRow::ALONG) * 3);
        let mut before = None;
        for (n, line) in self.lines.iter().enumerate() {
            let link = ends(&self.layout.lines[*line]);
            let gap = if before.replace(link) == Some(link) || n == 0 { 2 } else { 14 };
            let data = self.marks(&self.said(*line), columns);
            rows.push(ChartRow { label: self.name(*line), height: 22, gap, data, ..ChartRow::default() });
            let next = self.lines.get(n + 1).map(|line| &self.layout.lines[*line]);
            if next.is_none_or(|next| ends(next) != link) {
                rows.extend(self.states.iter().filter(|state| state.of == link).map(|state| self.state_row(state)));
            }
        }
        if !self.inputs.is_empty() {
            let said = |(at, text): &(Instant, String)| BusMessage { at: *at, line: 0, text: text.clone(), flaw: true };
            let said: Vec<BusMessage> = self.inputs.iter().map(said).collect();
            let data = self.marks(&said.iter().collect::<Vec<_>>(), columns);
            let label = "from outside".to_owned();
            rows.push(ChartRow { label, height: 22, gap: 14, data, ..ChartRow::default() });
        }
        Chart {
            id: "chart-bus".to_owned(),
            title: "who sent what when".to_owned(),
            range: (0.0, self.until.as_secs_f64()),
            unit: "s",
            rows,
        }
    }

    fn x(&self, at: Instant) -> f64 {
        at.as_nanos() as f64 / self.until.as_nanos().max(1) as f64 * f64::from(ChartRow::UNITS.0)
    }

    /// A mark for each thing, or for all of a kind that one column would show in one place.
    fn marks(&self, said: &[&BusMessage], columns: u64) -> String {
        let mut svg = String::new();
        let until = u128::from(self.until.as_nanos().max(1));
        let column = |at: Instant| u128::from(at.as_nanos()) * u128::from(columns) / until;
        for chunk in said.chunk_by(|a, b| column(a.at) == column(b.at) && a.class() == b.class()) {
            let class = chunk[0].class();
            let mut title = String::new();
            for said in chunk.iter().take(TOLD) {
                let _ = writeln!(title, "{:.6} s  {}", said.at.as_secs_f64(), said.text);
            }
            if chunk.len() > TOLD {
                let _ = write!(title, "and {} more", chunk.len() - TOLD);
            }
            let top = if class == "control" { 800 } else { 100 };
            let _ = write!(
                svg,
                "<path class=\"{class}\" d=\"M{:.2} {top}V1900\"><title>{}</title></path>",
                self.x(chunk[0].at),
                escaped_lines(title.trim_end())
            );
        }
        svg
    }

    fn state_row(&self, state: &State) -> ChartRow {
        let mut data = String::new();
        for (from, to) in &state.spans {
            let (a, b) = (self.x(*from), self.x(*to));
            let title = format!(
                "{} from {:.3} s to {:.3} s: {:.3} s",
                state.name,
                from.as_secs_f64(),
                to.as_secs_f64(),
                to.since(*from).as_secs_f64()
            );
            let _ = write!(
                data,
                "<path class=\"on\" d=\"M{a:.2} 0H{b:.2}V2000H{a:.2}Z\"><title>{}</title></path>",
                escaped(&title)
            );
        }
        ChartRow { label: state.name.clone(), height: 12, gap: 5, data, ..ChartRow::default() }
    }

    /// From where to where it is shown close up, in seconds: what the PC said first, and what came of it at once.
    fn first_burst(&self) -> Option<(f64, f64)> {
        let outside = |said: &BusMessage| self.layout.sends_outside(&self.layout.lines[said.line]);
        let first = self.characters.iter().position(outside)?;
        let begin = self.characters[first].at.as_secs_f64() - self.character_s(self.characters[first].line);
        let mut end = self.characters[first].at.as_secs_f64();
        for said in &self.characters[first..] {
            let at = said.at.as_secs_f64();
            if at - end > SILENCE || at - begin > LONGEST {
                break;
            }
            end = at;
        }
        let long = end - begin;
        // Room for the words of the last at the right.
        Some(((begin - 0.02 * long).max(0.0), end + 0.08 * long + 0.0001))
    }

    /// The first that the PC said, close up: every character.
    pub(super) fn close_up(&self) -> Option<Chart> {
        let range = self.first_burst()?;
        let x = |seconds: f64| (seconds - range.0) / (range.1 - range.0) * f64::from(ChartRow::ALONG);
        let within = |said: &&BusMessage| (range.0..=range.1).contains(&said.at.as_secs_f64());
        let mut rows = Vec::new();
        for line in &self.lines {
            let characters: Vec<&BusMessage> =
                self.characters.iter().filter(|said| said.line == *line).filter(within).collect();
            if characters.is_empty() {
                continue;
            }
            let messages: Vec<&BusMessage> =
                self.messages.iter().filter(|said| said.line == *line).filter(within).collect();
            let length = self.character_s(*line);
            let mut data = String::new();
            for said in &characters {
                // It is told in the middle of its stop bit.
                let from = x(said.at.as_secs_f64() - 0.95 * length);
                let width = length / (range.1 - range.0) * f64::from(ChartRow::ALONG);
                let class = if said.flaw { "flaw" } else { "character" };
                let _ = write!(
                    data,
                    "<g class=\"{class}\"><rect x=\"{:.1}\" y=\"22\" width=\"{:.1}\" height=\"19\"/>",
                    from + 0.5,
                    (width - 1.0).max(0.5)
                );
                if width > 17.0 {
                    let middle = from + width / 2.0;
                    let _ = write!(data, "<text x=\"{middle:.1}\" y=\"36\">{}</text>", escaped(said.kind()));
                }
                let _ = write!(data, "<title>{}</title></g>", escaped(&said.text));
            }
            let mut free = 0.0;
            for (n, said) in messages.iter().enumerate() {
                let before = n.checked_sub(1).map_or(Instant::START, |n| messages[n].at);
                let first = characters.iter().find(|character| character.at > before).map_or(said.at, |first| first.at);
                let from = x(first.as_secs_f64() - 0.95 * length);
                // Short messages may begin further left, if there is room.
                let wide = width_of(&said.text);
                let from = from.min(f64::from(ChartRow::ALONG) - wide).max(free);
                let room = messages
                    .get(n + 1)
                    .map_or(f64::from(ChartRow::ALONG), |next| x(next.at.as_secs_f64() - length).max(from));
                let shown = fitting(&said.text, room - from);
                free = from + width_of(&shown) + 10.0;
                let _ = write!(
                    data,
                    "<text class=\"{}\" x=\"{from:.1}\" y=\"15\">{}<title>{}</title></text>",
                    said.class(),
                    escaped(&shown),
                    escaped(&said.text)
                );
            }
            rows.push(ChartRow {
                label: self.name(*line),
                height: 46,
                gap: 6,
                data,
                size: (ChartRow::ALONG, 46),
                ..ChartRow::default()
            });
        }
        Some(Chart {
            id: "chart-close".to_owned(),
            title: "the first that was said, close up".to_owned(),
            range: (range.0 * 1e3, range.1 * 1e3),
            unit: "ms",
            rows,
        })
    }
}

/// About how wide a letter of 12 px is.
const WIDE: f64 = 5.8;

/// About how wide a text of 12 px is.
fn width_of(text: &str) -> f64 {
    WIDE * text.chars().count() as f64
}

/// As much of a text as has room.
fn fitting(text: &str, room: f64) -> String {
    if width_of(text) <= room {
        return text.to_owned();
    }
    let most = (room / WIDE).max(1.0) as usize - 1;
    let cut: String = text.chars().take(most).collect();
    format!("{}…", cut.trim_end())
}

/// Lines of text in a tooltip.
fn escaped_lines(text: &str) -> String {
    text.lines().map(escaped).collect::<Vec<_>>().join("\n")
}

/// The boards of the link that a line belongs to.
fn ends(line: &LineLayout) -> (usize, usize) {
    (line.from.0.min(line.to.0), line.from.0.max(line.to.0))
}

/// What boards wait for, and what of them is only on or off.
fn states(trace: &Trace, courses: &Courses, until: Instant) -> Vec<State> {
    let layout = &trace.header.layout;
    let mut states = Vec::new();
    for (n, board) in layout.boards.iter().enumerate() {
        let sends = |port: Option<u8>| {
            layout.lines.iter().find(|line| line.from.0 == n && port.is_none_or(|port| port == line.from.1))
        };
        if board.is_gateway() {
            // What the PC's UART tells is whether it is held.
            let link = sends(None).map_or((n, n), ends);
            let course = courses.of(n, usize::from(STOPPED));
            states.splice(0..0, course.map(|course| State::new(PC_HELD.to_owned(), link, course, until, 0)));
            continue;
        }
        for wait in &board.description.waits {
            let Some(course) = courses.of(n, usize::from(wait.signal)) else { continue };
            for (bit, port) in wait.ports.iter().enumerate() {
                let Some(line) = sends(Some(*port)) else { continue };
                let name = format!("{} busy", layout.boards[line.to.0].name);
                states.push(State::new(name, ends(line), course, until, bit as u32));
            }
        }
        for (signal, known) in board.description.signals.iter().enumerate() {
            let waits = board.description.waits.iter().any(|wait| usize::from(wait.signal) == signal);
            let Some(course) = courses.of(n, signal).filter(|_| !waits) else { continue };
            if course.len() > 1 && lasting(course, until).all(|(_, value)| value == 0 || value == 1) {
                let name = format!("{} {}", board.name, known.name.replace('_', " "));
                let of = sends(None).map_or((n, n), ends);
                states.push(State::new(name, of, course, until, 0));
            }
        }
    }
    states
}
