//! The trace's format: how each part is laid out. See the [module](super) for the whole.

use serde::{Deserialize, Serialize};
use torno_protocol::board::PinOutput;
use torno_protocol::layout::{BoardLayout, Layout};
use torno_protocol::line::{Edge, Level};
use torno_protocol::time::{Instant, Span};
use torno_protocol::train::Train;
use torno_protocol::uart::ReceiverKind;

use torno_engine::{Disturbance, Fact, Input, InputKind};

/// The version of the format.
pub const VERSION: u16 = 5;

/// What every trace begins with. Its first byte is no text, its last two tell whether somebody has changed line ends.
pub const MAGIC: [u8; 8] = *b"\x89torno\r\n";

/// Length and checksum.
pub(super) const PREFIX: usize = 12;

pub(super) const HEADER: u8 = 0;
pub(super) const ENTRIES: u8 = 1;
pub(super) const END: u8 = 2;

const EDGES: u64 = 0;
const TELEMETRY: u64 = 1;
const EVENT: u64 = 2;
const INPUT: u64 = 3;
const PIN: u64 = 4;

/// Bytes of the longest varint.
const VARINT_MAX: u32 = 10;

/// What was recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// The version of torno that recorded it.
    pub torno: String,
    /// The rig as it was named: built in, or a file.
    pub rig: String,
    /// The rig file's text.
    pub text: String,
    /// The seed.
    pub seed: u64,
    /// The program that `torno run` played, which stops at the first failure. None: the PC was outside, at the port of
    /// `torno up`.
    pub program: Option<String>,
    /// What the rig consists of.
    pub layout: Layout,
}

/// How a session ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct End {
    /// The digest of everything that had happened.
    pub digest: String,
    /// The last instant of the session. Everything up to it, and nothing after it, is in the trace.
    pub at: Instant,
    /// The word for how it ended.
    pub outcome: String,
}

impl Header {
    /// The header for a session of a rig that was named `rig`, whose file's text is `text`.
    pub fn new(layout: Layout, text: &str, rig: &str, seed: u64, program: Option<&str>) -> Self {
        Self {
            torno: env!("CARGO_PKG_VERSION").to_owned(),
            rig: rig.to_owned(),
            text: text.to_owned(),
            seed,
            program: program.map(str::to_owned),
            layout,
        }
    }
}

/// Appends a header: the header itself, and behind it the receivers of each board's ports.
pub(super) fn put_header(header: &Header, buffer: Vec<u8>) -> Result<Vec<u8>, postcard::Error> {
    let receivers: Vec<&[ReceiverKind]> = header.layout.boards.iter().map(|board| &board.receivers[..]).collect();
    postcard::to_extend(&receivers, postcard::to_extend(header, buffer)?)
}

/// Takes a header out of a block, as a version of the format has it; gives the bytes that follow it.
pub(super) type TakeHeader = fn(&[u8]) -> Option<(Header, &[u8])>;

/// As this version has it.
pub(super) fn take_header(bytes: &[u8]) -> Option<(Header, &[u8])> {
    postcard::take_from_bytes(bytes).ok()
}

/// Reads a header. Without receivers behind it, it is of a trace from before there were any: `today` then gives those
/// that the same rig has now.
pub(super) fn header(
    bytes: &[u8],
    take: TakeHeader,
    today: impl Fn(&str, &str) -> Option<(Layout, String)>,
) -> Option<Header> {
    let (mut header, rest) = take(bytes)?;
    if !header.layout.is_sound() {
        return None;
    }
    if rest.is_empty() {
        take_receivers(&mut header.layout, today(&header.rig, &header.text).map(|(layout, _)| layout).as_ref());
        return Some(header);
    }
    let receivers: Vec<Vec<ReceiverKind>> = postcard::from_bytes(rest).ok()?;
    let boards = &mut header.layout.boards;
    let fits = |(board, receivers): (&BoardLayout, &Vec<_>)| {
        receivers.is_empty() || receivers.len() == board.description.ports.len()
    };
    if boards.len() != receivers.len() || !boards.iter().zip(&receivers).all(fits) {
        return None;
    }
    boards.iter_mut().zip(receivers).for_each(|(board, receivers)| board.receivers = receivers);
    Some(header)
}

/// Gives each board the receivers that the board of the same name and kind has today.
pub(super) fn take_receivers(layout: &mut Layout, today: Option<&Layout>) {
    for board in &mut layout.boards {
        let same = |other: &&BoardLayout| (&other.name, &other.kind) == (&board.name, &board.kind);
        let known = today.and_then(|today| today.boards.iter().find(same));
        board.receivers = known.map_or_else(Vec::new, |known| known.receivers.clone());
    }
}

/// One thing in a block of entries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Entry {
    Fact(Fact),
    Input(Input),
}

/// Appends a fact; `last` is the instant of the entry before.
pub(super) fn put_fact(fact: &Fact, last: &mut u64, buffer: &mut Vec<u8>) {
    match fact {
        Fact::Edges { line, edges } => {
            let at = edges.first().map_or(*last, |edge| edge.at.as_nanos());
            put_start(EDGES, *line, at, last, buffer);
            put_varint(edges.len() as u64, buffer);
            let mut before = at;
            for edge in edges {
                put_edge(edge.at.as_nanos().wrapping_sub(before), edge.level, buffer);
                before = edge.at.as_nanos();
            }
        }
        Fact::Telemetry { node, at, signal, value } => {
            put_start(TELEMETRY, *node, at.as_nanos(), last, buffer);
            buffer.push(*signal);
            put_varint(zigzag(*value), buffer);
        }
        Fact::Event { node, at, event, value } => {
            put_start(EVENT, *node, at.as_nanos(), last, buffer);
            buffer.push(*event);
            put_varint(zigzag(*value), buffer);
        }
        Fact::Pin { node, at, pin, what } => {
            put_start(PIN, *node, at.as_nanos(), last, buffer);
            buffer.push(*pin);
            let (level, train) = match what {
                PinOutput::Level(level) => (1 + u8::from(*level == Level::High), None),
                PinOutput::Pulses(train) => (0, Some(train)),
            };
            buffer.push(level);
            if let Some(Train { first, nanos, per, count, high }) = train {
                let after = first.as_nanos().wrapping_sub(at.as_nanos());
                for number in [after, *nanos, *per, *count, high.as_nanos()] {
                    put_varint(number, buffer);
                }
            }
        }
    }
}

/// Appends an input.
pub(super) fn put_input(input: &Input, last: &mut u64, buffer: &mut Vec<u8>) -> Result<(), postcard::Error> {
    put_start(INPUT, 0, input.at.as_nanos(), last, buffer);
    put_varint(input.given.as_nanos(), buffer);
    *buffer = postcard::to_extend(&input.what, core::mem::take(buffer))?;
    Ok(())
}

fn put_start(kind: u64, number: usize, at: u64, last: &mut u64, buffer: &mut Vec<u8>) {
    put_varint(kind | (number as u64) << 3, buffer);
    put_varint(zigzag(at.wrapping_sub(*last) as i64), buffer);
    *last = at;
}

const fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

const fn unzigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

fn put_varint(mut value: u64, buffer: &mut Vec<u8>) {
    while value >= 0x80 {
        buffer.push(value as u8 | 0x80);
        value >>= 7;
    }
    buffer.push(value as u8);
}

/// Shifted by one, a gap below 2^63 still fits; one that is not is refused when it is read.
fn put_edge(gap: u64, level: Level, buffer: &mut Vec<u8>) {
    put_varint(gap << 1 | u64::from(level == Level::High), buffer);
}

/// Takes the entries of a block apart. `None` at any step: the block is not what it should be.
pub(super) struct Entries<'a> {
    rest: &'a [u8],
    last: u64,
    what: ReadWhat,
}

/// Reads what came from outside, as a version of the format has it; gives the bytes that follow it.
pub(super) type ReadWhat = fn(&[u8]) -> Option<(InputKind, &[u8])>;

/// As this version has it.
pub(super) fn what(bytes: &[u8]) -> Option<(InputKind, &[u8])> {
    postcard::take_from_bytes(bytes).ok()
}

impl<'a> Entries<'a> {
    pub(super) const fn new(bytes: &'a [u8], what: ReadWhat) -> Self {
        Self { rest: bytes, last: 0, what }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// The next entry of a trace with this header.
    pub(super) fn next(&mut self, header: &Header) -> Option<Entry> {
        let tag = self.varint()?;
        let number = usize::try_from(tag >> 3).ok()?;
        let at = self.last.wrapping_add(unzigzag(self.varint()?) as u64);
        let at = self.instant(at)?;
        let entry = match tag & 7 {
            EDGES => Entry::Fact(Fact::Edges { line: number, edges: self.edges(at)? }),
            TELEMETRY => {
                let signal = self.byte()?;
                Entry::Fact(Fact::Telemetry { node: number, at, signal, value: unzigzag(self.varint()?) })
            }
            EVENT => {
                let event = self.byte()?;
                Entry::Fact(Fact::Event { node: number, at, event, value: unzigzag(self.varint()?) })
            }
            PIN => {
                let pin = self.byte()?;
                let what = match self.byte()? {
                    0 => PinOutput::Pulses(self.train(at)?),
                    1 => PinOutput::Level(Level::Low),
                    2 => PinOutput::Level(Level::High),
                    _ => return None,
                };
                Entry::Fact(Fact::Pin { node: number, at, pin, what })
            }
            INPUT if number == 0 => {
                let given = self.varint()?;
                let given = Instant::from_nanos(i64::try_from(given).ok()? as u64);
                let (what, rest) = (self.what)(self.rest)?;
                self.rest = rest;
                Entry::Input(Input { given, at, what })
            }
            _ => return None,
        };
        refers_to(&entry, header).then_some(entry)
    }

    fn edges(&mut self, at: Instant) -> Option<Vec<Edge>> {
        let count = self.varint()?;
        let mut edges = Vec::new();
        let mut last = at.as_nanos();
        for _ in 0..count {
            let gap = self.varint()?;
            last = last.checked_add(gap >> 1).filter(|last| i64::try_from(*last).is_ok())?;
            let level = if gap & 1 == 1 { Level::High } else { Level::Low };
            edges.push(Edge { at: Instant::from_nanos(last), level });
        }
        Some(edges)
    }

    fn train(&mut self, at: Instant) -> Option<Train> {
        let first = at.as_nanos().checked_add(self.varint()?).filter(|first| i64::try_from(*first).is_ok())?;
        let (nanos, per, count) = (self.varint()?, self.varint()?, self.varint()?);
        Some(Train { first: Instant::from_nanos(first), nanos, per, count, high: Span::from_nanos(self.varint()?) })
    }

    /// Far from the end of time nothing saturates.
    fn instant(&mut self, at: u64) -> Option<Instant> {
        self.last = i64::try_from(at).ok()? as u64;
        Some(Instant::from_nanos(at))
    }

    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(*first)
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for n in 0..VARINT_MAX {
            let byte = self.byte()?;
            let part = u64::from(byte & 0x7f);
            if part << (7 * n) >> (7 * n) != part {
                return None;
            }
            value |= part << (7 * n);
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }
}

/// Whether the lines and boards that an entry is about are there.
fn refers_to(entry: &Entry, header: &Header) -> bool {
    let (line, board) = match entry {
        Entry::Fact(Fact::Edges { line, .. }) => (Some(*line), None),
        Entry::Fact(Fact::Telemetry { node, .. } | Fact::Event { node, .. } | Fact::Pin { node, .. }) => {
            (None, Some(*node))
        }
        Entry::Input(Input { what, .. }) => match what {
            // A line can touch another, but not itself.
            InputKind::Disturbed { line, disturbance: Disturbance::Short(other), .. } if line == other => return false,
            InputKind::Disturbed { line, disturbance: Disturbance::Short(other), .. } => (Some(*line.max(other)), None),
            InputKind::Disturbed { line, .. } | InputKind::Healed { line, .. } => (Some(*line), None),
            InputKind::Stimulus { board, .. }
            | InputKind::Stopped { board, .. }
            | InputKind::Continued { board }
            | InputKind::Died { board, .. } => (None, Some(*board)),
        },
    };
    line.is_none_or(|line| line < header.layout.lines.len())
        && board.is_none_or(|board| board < header.layout.boards.len())
}
