//! Faults as files say them: a table with the place, the kind, and what the kind needs.

use std::ops::Range;

use serde::Deserialize;
use toml::{Spanned, Value};
use torno_protocol::board::Heeds;
use torno_protocol::clock::Clock;
use torno_protocol::line::Level;
use torno_protocol::time::Span;

use super::{Ailment, BROWN_OUT, Fault, What, parse_ratio, parse_span};
use crate::engine::{Disturbance, LineId, NodeId, Tampering};
use crate::rig::file::RigFile;
use crate::scenario::RawCondition;
use crate::text::{Complaint, nearest};

/// What can happen to a line.
pub const LINE_KINDS: [&str; 9] =
    ["cut", "stuck-low", "stuck-high", "short", "noise", "flip", "delay", "drop", "double"];
/// What can happen to a board.
pub const BOARD_KINDS: [&str; 14] = [
    "crash",
    "hang",
    "reset",
    "power-off",
    "brown-out",
    "slow",
    "clock",
    "drift",
    "counts",
    "stall",
    "load",
    "supply",
    "backlash",
    "end-stop",
];

/// The fields that a kind of fault has, beyond those that all have.
fn fields_of(kind: &str) -> &'static [&'static str] {
    match kind {
        "short" => &["with"],
        "noise" => &["period", "width"],
        "flip" => &["nth", "value"],
        "delay" => &["nth", "edge", "value"],
        "drop" | "double" => &["nth"],
        "slow" | "clock" | "drift" | "counts" | "load" | "supply" | "backlash" | "end-stop" => &["value"],
        _ => &[],
    }
}

/// The names that a rig gives to its parts.
#[derive(Clone, Debug)]
pub struct Names {
    /// Boards, and last the PC.
    pub boards: Vec<String>,
    /// The quantities of each.
    pub signals: Vec<Vec<String>>,
    /// The events' texts of each.
    pub events: Vec<Vec<String>>,
    /// What each heeds.
    pub heeds: Vec<Vec<Heeds>>,
    /// Lines.
    pub lines: Vec<String>,
    /// What sends on each line: the board and its port.
    pub senders: Vec<(NodeId, u8)>,
}

impl Names {
    /// The names in a rig, in the order of the engine's numbers.
    pub fn of(file: &RigFile) -> Self {
        let pc = crate::pc::PcUart::new(file.pc.baud, file.pc.tx_fifo, file.pc.clock);
        let pc = torno_protocol::board::Board::description(&pc);
        let described = || file.boards.iter().map(|board| &board.description).chain([&pc]);
        let boards: Vec<String> = file.boards.iter().map(|board| board.name.clone()).chain(["pc".to_owned()]).collect();
        let (lines, senders) = file.lines().into_iter().map(|line| (line.name, line.from)).unzip();
        Self {
            signals: described().map(|d| d.signals.iter().map(|signal| signal.name.clone()).collect()).collect(),
            events: described().map(|d| d.events.clone()).collect(),
            heeds: described().map(|d| d.heeds.clone()).collect(),
            boards,
            lines,
            senders,
        }
    }

    /// The number of a board.
    ///
    /// # Errors
    /// Where, and the nearest known name.
    pub fn board(&self, name: &Spanned<String>) -> Result<NodeId, Complaint> {
        find("board", name, &self.boards)
    }

    /// The number of a line.
    ///
    /// # Errors
    /// Where, and the nearest known name.
    pub fn line(&self, name: &Spanned<String>) -> Result<LineId, Complaint> {
        find("line", name, &self.lines)
    }

    /// The number of a board's quantity.
    ///
    /// # Errors
    /// Where, and the nearest known name.
    pub fn signal(&self, board: NodeId, name: &Spanned<String>) -> Result<u8, Complaint> {
        find(&format!("quantity of '{}'", self.boards[board]), name, &self.signals[board]).map(|place| place as u8)
    }
}

fn find(what: &str, name: &Spanned<String>, known: &[String]) -> Result<usize, Complaint> {
    known.iter().position(|other| other == name.get_ref()).ok_or_else(|| {
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        (name.span(), format!("there is no {what} '{}'{}", name.get_ref(), nearest(name.get_ref(), &known)))
    })
}

/// A fault as a file says it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawFault {
    name: Option<Spanned<String>>,
    line: Option<Spanned<String>>,
    board: Option<Spanned<String>>,
    kind: Spanned<String>,
    value: Option<Spanned<Value>>,
    with: Option<Spanned<String>>,
    nth: Option<Spanned<u64>>,
    edge: Option<Spanned<u8>>,
    period: Option<Spanned<String>>,
    width: Option<Spanned<String>>,
    r#for: Option<Spanned<String>>,
    pub(crate) at: Option<Spanned<String>>,
    pub(crate) when: Option<RawCondition>,
}

impl RawFault {
    /// The fault, in a rig with these names. `number` tells it from the others of its file, `seed` is the file's.
    ///
    /// # Errors
    /// Where, what was expected, what was found.
    pub fn check(&self, names: &Names, number: usize, seed: u64) -> Result<Fault, Complaint> {
        let kind = self.kind.get_ref().as_str();
        let known = LINE_KINDS.contains(&kind) || BOARD_KINDS.contains(&kind);
        if let Some((field, place)) = self.fields().find(|(field, _)| known && !fields_of(kind).contains(field)) {
            return Err((place, format!("'{kind}' has no {field}")));
        }
        if let Some(nth) = self.nth.as_ref().filter(|nth| *nth.get_ref() == 0) {
            return Err((nth.span(), "nth counts from 1".to_owned()));
        }
        let what = match (&self.line, &self.board) {
            (Some(line), None) => {
                What::Line(names.line(line)?, self.disturbance(names, seed ^ ((number as u64 + 1) << 32))?)
            }
            (None, Some(board)) => {
                let (node, ailment) = (names.board(board)?, self.ailment()?);
                self.mean_something(names, node, ailment)?;
                What::Board(node, ailment)
            }
            _ => return Err((self.kind.span(), format!("'{kind}': expected the place, either line or board"))),
        };
        let lasts = self.r#for.as_ref().map(span).transpose()?;
        let lasts = if kind == "brown-out" { Some(lasts.unwrap_or(BROWN_OUT)) } else { lasts };
        let place =
            self.line.as_ref().or(self.board.as_ref()).map(|place| place.get_ref().as_str()).unwrap_or_default();
        let name = self.name.as_ref().map_or_else(|| format!("{place} {kind}"), |name| name.get_ref().clone());
        Ok(Fault { name, what, lasts })
    }

    /// Refuses a name that one of the `known` faults bears: they would hide each other.
    ///
    /// # Errors
    /// Where, and what was expected.
    pub(crate) fn bear_its_own_name<'a>(
        &self,
        fault: &Fault,
        known: impl IntoIterator<Item = &'a Fault>,
    ) -> Result<(), Complaint> {
        if known.into_iter().all(|other| other.name != fault.name) {
            return Ok(());
        }
        let place = self.name.as_ref().map_or_else(|| self.kind.span(), Spanned::span);
        Err((place, format!("there is a fault '{}' already: expected another name", fault.name)))
    }

    /// Refuses what would happen to a board without what it happens to.
    fn mean_something(&self, names: &Names, node: NodeId, ailment: Ailment) -> Result<(), Complaint> {
        let Some(needed) = ailment.needs() else { return Ok(()) };
        if names.heeds[node].contains(&needed) {
            return Ok(());
        }
        let heeding = names.boards.iter().zip(&names.heeds).filter(|(_, heeds)| heeds.contains(&needed));
        let boards: Vec<&str> = heeding.map(|(name, _)| name.as_str()).collect();
        let message = format!("'{}' means nothing to '{}'", self.kind.get_ref(), names.boards[node]);
        Err((self.kind.span(), format!("{message}: expected one of the boards {}", boards.join(", "))))
    }

    /// What it says beyond its place, its kind and its time, and where.
    fn fields(&self) -> impl Iterator<Item = (&'static str, Range<usize>)> {
        let fields = [
            ("value", self.value.as_ref().map(Spanned::span)),
            ("with", self.with.as_ref().map(Spanned::span)),
            ("nth", self.nth.as_ref().map(Spanned::span)),
            ("edge", self.edge.as_ref().map(Spanned::span)),
            ("period", self.period.as_ref().map(Spanned::span)),
            ("width", self.width.as_ref().map(Spanned::span)),
        ];
        fields.into_iter().filter_map(|(field, place)| Some((field, place?)))
    }

    fn disturbance(&self, names: &Names, seed: u64) -> Result<Disturbance, Complaint> {
        let tampering = |what| Disturbance::Character { nth: self.nth.as_ref().map_or(1, |nth| *nth.get_ref()), what };
        Ok(match self.kind.get_ref().as_str() {
            "cut" => Disturbance::Cut,
            "stuck-low" => Disturbance::Stuck(Level::Low),
            "stuck-high" => Disturbance::Stuck(Level::High),
            "short" => {
                let with = self.with.as_ref().ok_or_else(|| self.lacks("with", "the line that it touches"))?;
                let other = names.line(with)?;
                if self.line.as_ref().is_some_and(|line| line.get_ref() == with.get_ref()) {
                    return Err((with.span(), "a line cannot touch itself: expected another line".to_owned()));
                }
                Disturbance::Short(other)
            }
            "noise" => {
                let period =
                    self.period.as_ref().ok_or_else(|| self.lacks("period", "the mean time between pulses"))?;
                let width = self.width.as_ref().map_or(Ok(Span::from_micros(50)), span)?;
                let found = span(period)?;
                if found < Span::from_micros(1) {
                    return Err((period.span(), format!("'{}': expected 1 us or more", period.get_ref())));
                }
                Disturbance::Noise { period: found, width, seed }
            }
            "flip" => tampering(Tampering::Flip(self.integer(0, 9, "the bit, 0 (start) to 9 (stop)")? as u8)),
            "delay" => {
                let edge = self.edge.as_ref().map_or(0, |edge| *edge.get_ref());
                tampering(Tampering::Delay { edge, by: self.time("how late the edge comes")? })
            }
            "drop" => tampering(Tampering::Drop),
            "double" => tampering(Tampering::Double),
            _ => return Err(self.unknown("line", &LINE_KINDS)),
        })
    }

    fn ailment(&self) -> Result<Ailment, Complaint> {
        Ok(match self.kind.get_ref().as_str() {
            "crash" => Ailment::Crash,
            "hang" => Ailment::Hang,
            "reset" => Ailment::Reset,
            "power-off" | "brown-out" => Ailment::PowerOff,
            "slow" => Ailment::Slow(self.time("how long the firmware takes over everything")?),
            "clock" => {
                let ppb = self.ratio(-200_000_000, 200_000_000, "the oscillator's error, -20 % to 20 %")?;
                Ailment::Clock(Clock::from_ppb(ppb as i32).unwrap_or(Clock::TRUE))
            }
            "drift" => Ailment::Drift(self.ratio(-10_000_000, 10_000_000, "the drift a second, -1 % to 1 %")? as i32),
            "counts" => Ailment::Counts(self.integer(-1_000_000, 1_000_000, "so many counts")? as i32),
            "stall" => Ailment::Stall,
            "load" => {
                let load = self.ratio(0, 2_000_000_000, "the share of the torque at standstill, 0 % to 200 %")?;
                Ailment::Load((load / 1_000_000) as i32)
            }
            "supply" => {
                let supply = self.ratio(0, 2_000_000_000, "the share of the nominal supply, 0 % to 200 %")?;
                Ailment::Supply((supply / 1_000_000) as u16)
            }
            "backlash" => Ailment::Backlash(self.integer(0, i64::from(u16::MAX), "so many counts")? as u16),
            "end-stop" => Ailment::EndStop(self.integer(-10_000_000, 10_000_000, "counts from mid-travel")? as i32),
            _ => return Err(self.unknown("board", &BOARD_KINDS)),
        })
    }

    fn unknown(&self, place: &str, kinds: &[&str]) -> Complaint {
        let kind = self.kind.get_ref();
        (self.kind.span(), format!("there is no fault '{kind}' of a {place}{}", nearest(kind, kinds)))
    }

    fn lacks(&self, field: &str, what: &str) -> Complaint {
        (self.kind.span(), format!("'{}': expected {field}: {what}", self.kind.get_ref()))
    }

    fn value(&self, what: &str) -> Result<&Spanned<Value>, Complaint> {
        self.value.as_ref().ok_or_else(|| self.lacks("value", what))
    }

    fn time(&self, what: &str) -> Result<Span, Complaint> {
        let value = self.value(what)?;
        let text = value.get_ref().as_str().unwrap_or_default();
        parse_span(text).map_err(|message| (value.span(), format!("{what}: {message}")))
    }

    fn ratio(&self, least: i64, most: i64, what: &str) -> Result<i64, Complaint> {
        let value = self.value(what)?;
        let text = value.get_ref().as_str().unwrap_or_default();
        let found = parse_ratio(text).map_err(|message| (value.span(), format!("{what}: {message}")))?;
        if (least..=most).contains(&found) {
            Ok(found)
        } else {
            Err((value.span(), format!("'{text}': expected {what}")))
        }
    }

    fn integer(&self, least: i64, most: i64, what: &str) -> Result<i64, Complaint> {
        let value = self.value(what)?;
        let found = value.get_ref().as_integer().filter(|found| (least..=most).contains(found));
        found.ok_or_else(|| (value.span(), format!("expected {what}, {least} to {most}, found {}", value.get_ref())))
    }
}

/// A time in a file.
///
/// # Errors
/// Where, and what was expected.
pub(crate) fn span(text: &Spanned<String>) -> Result<Span, Complaint> {
    parse_span(text.get_ref()).map_err(|message| (text.span(), message))
}
