//! Faults as files say them: a table with the place, the kind, and what the kind needs.

use std::ops::Range;
use std::path::Path;

use serde::{Deserialize, Serialize};
use toml::{Spanned, Value};
use torno_protocol::board::{Capability, Channel};
use torno_protocol::clock::Clock;
use torno_protocol::line::Level;
use torno_protocol::time::{Instant, Span};

use super::{BROWN_OUT, BoardFault, Fault, NEVER_A_PULSE, Planned, Site, Trigger};
use crate::condition::RawCondition;
use crate::text_file::TextError;
use torno_bus::Names;
use torno_engine::{Disturbance, NodeId, Tampering};
use torno_text::{Complaint, Invalid, nearest};
use torno_text::{Dice, Range as Quantities, Ratio, parse_length, parse_ratio, parse_span, span};

/// What can happen to a line.
pub const LINE_KINDS: [&str; 9] =
    ["cut", "stuck-low", "stuck-high", "short", "noise", "flip", "delay", "drop", "double"];
/// What can happen to a board.
pub const BOARD_KINDS: [&str; 20] = [
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
    "push",
    "slip",
    "skip",
    "shift",
    "swap",
    "dead",
];

/// The longest pulse of noise, if nothing else is said. (Ours: half a bit at 9600 baud.)
const NOISE_WIDTH: Span = Span::from_micros(50);
/// Pulses of noise follow each other so closely at the most.
const PERIOD_MIN: Span = Span::from_micros(1);

/// The mean time from the end of one pulse of noise to the next that inverts the line for this share of the time: a
/// pulse lasts half the `width` in the mean.
fn noise_period(share: Ratio, width: Span) -> Span {
    let mean = width.as_nanos() as f64 / 2.0;
    match share {
        0 => NEVER_A_PULSE,
        share => Span::from_nanos((mean * (1e9 - share as f64) / share as f64).round() as u64),
    }
}

/// The fields that a kind of fault has, beyond those that all have.
fn fields_of(kind: &str) -> &'static [&'static str] {
    match kind {
        "short" => &["with"],
        "noise" => &["value", "period", "width"],
        "flip" => &["nth", "value"],
        "delay" => &["nth", "edge", "value"],
        "drop" | "double" => &["nth"],
        "slow" | "clock" | "drift" | "counts" | "load" | "supply" | "backlash" | "end-stop" | "push" | "slip"
        | "skip" | "shift" | "dead" => &["value"],
        _ => &[],
    }
}

/// A kind of fault, as it is offered to somebody who chooses one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FaultKind {
    /// Its name.
    pub kind: &'static str,
    /// Whether it is a line's; else a board's.
    pub line: bool,
    /// The fields that it has beyond those that all have, each with an example of its value.
    pub fields: Vec<(&'static str, &'static str)>,
    /// What a board or a motor must be capable of for it to mean anything.
    pub needs: Option<Capability>,
}

/// The kinds of faults.
pub fn fault_kinds() -> Vec<FaultKind> {
    let known = |kind: &'static str, line: bool| {
        let fields = fields_of(kind).iter().filter_map(|field| Some((*field, example(kind, field)?))).collect();
        let mut fault = FaultKind { kind, line, fields, needs: None };
        fault.needs = fault.raw("?").and_then(|raw| raw.fault().ok()?.needs());
        fault
    };
    LINE_KINDS.iter().map(|kind| known(kind, true)).chain(BOARD_KINDS.iter().map(|kind| known(kind, false))).collect()
}

/// An example of the value of a field of a kind of fault; none, where another field says the same.
fn example(kind: &str, field: &str) -> Option<&'static str> {
    Some(match (kind, field) {
        ("short", "with") => "",
        ("noise", "period") => "10 ms",
        ("noise", "width") => "50 us",
        ("flip", "value") => "5",
        ("delay", "edge") => "1",
        ("delay", "value") => "60 us",
        (_, "nth") => "1",
        ("slow", _) => "5 ms",
        ("clock", _) => "2 %",
        ("drift", _) => "0.1 %",
        ("counts", _) => "20",
        ("load", _) => "50 %",
        ("supply", _) => "70 %",
        ("backlash", _) => "40",
        ("end-stop", _) => "400",
        ("push", _) => "50 %",
        ("slip", _) => "-1",
        ("skip", _) => "400",
        ("shift", _) => "0.2 mm",
        ("dead", _) => "A",
        _ => return None,
    })
}

impl FaultKind {
    /// Such a fault at a place, with the examples' values.
    fn raw(&self, place: &str) -> Option<RawFault> {
        let mut table = toml::Table::new();
        table.insert("kind".to_owned(), self.kind.into());
        table.insert(if self.line { "line" } else { "board" }.to_owned(), place.into());
        for (field, example) in &self.fields {
            let value = example.parse().map_or_else(|_| Value::from(*example), Value::Integer);
            table.insert((*field).to_owned(), value);
        }
        toml::from_str(&toml::to_string(&table).ok()?).ok()
    }
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
    nth: Option<Spanned<Value>>,
    edge: Option<Spanned<Value>>,
    period: Option<Spanned<String>>,
    width: Option<Spanned<String>>,
    r#for: Option<Spanned<String>>,
    at: Option<Spanned<String>>,
    when: Option<Spanned<RawCondition>>,
}

/// A file of faults.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFile {
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    fault: Vec<RawFault>,
}

/// Why faults cannot be had from a file.
#[derive(Debug, thiserror::Error)]
pub enum FaultFileError {
    /// The file cannot be read.
    #[error("{path}: cannot read the faults")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        source: TextError,
    },
    /// They are none.
    #[error(transparent)]
    Invalid(#[from] Invalid),
}

/// The faults of a file.
#[derive(Clone, Debug, Default)]
pub struct FaultFile {
    /// Everything random comes from it.
    pub seed: u64,
    /// What has been drawn by lot from it, and for which place of the file.
    pub drawn: Vec<(String, String)>,
    /// The faults.
    pub faults: Vec<Planned>,
}

/// Reads a file of faults for a rig with these names. `seed` takes the place of what the file says.
///
/// # Errors
/// [`FaultFileError`]: where, what was expected, what was found.
pub fn load(path: &Path, names: &Names, seed: Option<u64>) -> Result<FaultFile, FaultFileError> {
    let name = path.display().to_string();
    match crate::text_file::read(path) {
        Ok(text) => Ok(parse(&name, &text, names, seed)?),
        Err(source) => Err(FaultFileError::Unreadable { path: name, source }),
    }
}

/// Reads the text of such a file. `path` is for the messages.
///
/// # Errors
/// Where, what was expected, what was found.
pub fn parse(path: &str, text: &str, names: &Names, seed: Option<u64>) -> Result<FaultFile, Invalid> {
    let invalid = |(span, message): Complaint| Invalid::at(path, text, span, message);
    let raw: RawFile = toml::from_str(text).map_err(|error| invalid(torno_text::of_toml(&error)))?;
    let seed = seed.unwrap_or(raw.seed);
    let mut dice = Dice::new(seed);
    let mut all: Vec<Planned> = Vec::new();
    for raw in &raw.fault {
        let planned = raw.plan(names, &mut dice).map_err(invalid)?;
        raw.check_name(&planned.fault, all.iter().map(|planned| &planned.fault)).map_err(invalid)?;
        all.push(planned);
    }
    Ok(FaultFile { seed, drawn: dice.into_drawn(), faults: all })
}

impl RawFault {
    /// The fault and when it begins: at the start, if nothing is said.
    ///
    /// # Errors
    /// As [`RawFault::check`].
    pub fn plan(&self, names: &Names, dice: &mut Dice) -> Result<Planned, Complaint> {
        let certain = self.drawn(names, dice)?;
        let fault = certain.check_drawn(names, dice)?;
        let trigger = match (&certain.at, &certain.when) {
            (Some(at), None) => Trigger::At(Instant::START + span(at)?),
            (None, Some(when)) => Trigger::When(when.get_ref().check(names)?),
            (None, None) => Trigger::At(Instant::START),
            (Some(at), Some(_)) => return Err((at.span(), "expected either at or when, not both".to_owned())),
        };
        Ok(Planned { trigger, fault })
    }

    /// Where it says when it begins, if it does.
    pub fn says_when(&self) -> Option<Range<usize>> {
        let when = self.when.as_ref().map(Spanned::span);
        self.at.as_ref().map(Spanned::span).or(when)
    }

    /// The fault, in a rig with these names.
    ///
    /// # Errors
    /// Where, what was expected, what was found.
    pub fn check(&self, names: &Names, dice: &mut Dice) -> Result<Fault, Complaint> {
        self.drawn(names, dice)?.check_drawn(names, dice)
    }

    /// Its name: what it is called, or its place and its kind.
    fn name(&self) -> String {
        let place = self.line.as_ref().or(self.board.as_ref()).map(|place| place.get_ref().as_str());
        let usual = || format!("{} {}", place.unwrap_or_default(), self.kind.get_ref());
        self.name.as_ref().map_or_else(usual, |name| name.get_ref().clone())
    }

    /// The same with a value for each range, by lot; the whole range must be allowed, whatever is drawn.
    fn drawn(&self, names: &Names, dice: &mut Dice) -> Result<Self, Complaint> {
        for n in 0..3 {
            self.chosen(|_, range| range.extremes()[n].clone())?.check_drawn(names, dice)?;
        }
        self.chosen(|place, range| dice.draw(place, range))
    }

    /// The same with the value for each range that is chosen for its place.
    fn chosen(&self, mut choose: impl FnMut(&str, &Quantities) -> String) -> Result<Self, Complaint> {
        let mut chosen = self.clone();
        let place = |field: &str| format!("fault.{}.{field}", self.name());
        let Self { at, r#for, period, width, value, nth, edge, .. } = &mut chosen;
        for (field, text) in [("at", at), ("for", r#for), ("period", period), ("width", width)] {
            if let Some(text) = text
                && let Some(range) = Quantities::parse(text.get_ref())
            {
                let range = range.map_err(|message| (text.span(), message))?;
                *text = Spanned::new(text.span(), choose(&place(field), &range));
            }
        }
        for (field, value) in [("value", value), ("nth", nth), ("edge", edge)] {
            if let Some(value) = value
                && let Some(range) = value.get_ref().as_str().and_then(Quantities::parse)
            {
                let range = range.map_err(|message| (value.span(), message))?;
                let text = choose(&place(field), &range);
                let number = text.parse().map(Value::Integer);
                *value = Spanned::new(value.span(), number.unwrap_or(Value::String(text)));
            }
        }
        Ok(chosen)
    }

    fn check_drawn(&self, names: &Names, dice: &Dice) -> Result<Fault, Complaint> {
        let kind = self.kind.get_ref().as_str();
        let known = LINE_KINDS.contains(&kind) || BOARD_KINDS.contains(&kind);
        if let Some((field, place)) = self.fields().find(|(field, _)| known && !fields_of(kind).contains(field)) {
            return Err((place, format!("'{kind}' has no {field}")));
        }
        let what = match (&self.line, &self.board) {
            (Some(line), None) => Site::Line(names.line(line)?, self.disturbance(names, dice.seed(&self.name()))?),
            (None, Some(board)) => {
                let ((node, motor), fault) = (names.board_or_motor(board)?, self.fault()?);
                self.mean_something(names, board.get_ref(), (node, motor), fault)?;
                Site::Board(node, motor, fault)
            }
            _ => return Err((self.kind.span(), format!("'{kind}': expected the place, either line or board"))),
        };
        let lasts = self.r#for.as_ref().map(span).transpose()?;
        if let Some(wrong) = self.r#for.as_ref() {
            if lasts == Some(Span::ZERO) {
                return Err((
                    wrong.span(),
                    "for: what lasts no time breaks nothing: expected a time above 0".to_owned(),
                ));
            }
            if what.is_over_at_once() {
                return Err((wrong.span(), format!("for: '{kind}' is over at once: expected no time")));
            }
        }
        let lasts = if kind == "brown-out" { Some(lasts.unwrap_or(BROWN_OUT)) } else { lasts };
        Ok(Fault { name: self.name(), what, lasts })
    }

    /// Refuses a name that one of the `known` faults bears: they would hide each other.
    ///
    /// # Errors
    /// Where, and what was expected.
    pub(crate) fn check_name<'a>(
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

    /// Refuses what would happen to a board or a motor without what it happens to.
    fn mean_something(
        &self,
        names: &Names,
        place: &str,
        (node, motor): (NodeId, Option<u8>),
        fault: BoardFault,
    ) -> Result<(), Complaint> {
        let capable: Vec<String> = match fault.needs() {
            None if motor.is_none() => return Ok(()),
            None => vec![names.boards[node].clone()],
            Some(needed) => names.capable(needed),
        };
        if capable.iter().any(|name| name == place) {
            return Ok(());
        }
        let message = format!("'{}' means nothing to '{place}'", self.kind.get_ref());
        Err((self.kind.span(), format!("{message}: expected one of the boards {}", capable.join(", "))))
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
        let tampering = |what| -> Result<Disturbance, Complaint> {
            let nth = self.nth.as_ref().map_or(Ok(1), |nth| whole(nth, 1, i64::MAX, "which character, from 1"))?;
            Ok(Disturbance::Character { nth: nth as u64, what })
        };
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
                let width = self.width.as_ref().map_or(Ok(NOISE_WIDTH), span)?;
                Disturbance::Noise { period: self.period(width)?, width, seed }
            }
            "flip" => tampering(Tampering::Flip(self.integer(0, 9, "the bit, 0 (start) to 9 (stop)")? as u8))?,
            "delay" => {
                let edge = self.edge.as_ref().map_or(Ok(0), |edge| whole(edge, 0, 9, "which edge of the character"))?;
                tampering(Tampering::Delay { edge: edge as u8, by: self.time("how late the edge comes")? })?
            }
            "drop" => tampering(Tampering::Drop)?,
            "double" => tampering(Tampering::Double)?,
            _ => return Err(self.unknown("line", &LINE_KINDS)),
        })
    }

    /// The mean time from one pulse of noise to the next.
    fn period(&self, width: Span) -> Result<Span, Complaint> {
        match (&self.period, &self.value) {
            (Some(text), None) => match span(text)? {
                found if found < PERIOD_MIN => {
                    Err((text.span(), format!("'{}': expected {PERIOD_MIN} or more", text.get_ref())))
                }
                found => Ok(found),
            },
            (None, Some(value)) => {
                let share = self.ratio(0, 500_000_000, "the share of the time that it is inverted, 0 % to 50 %")?;
                let period = noise_period(share, width);
                if period < PERIOD_MIN {
                    let message = "value: pulses would be closer than 1 us: expected a smaller share or a larger width";
                    return Err((value.span(), message.to_owned()));
                }
                Ok(period)
            }
            (None, None) => {
                Err(self.lacks("period or value", "the mean time between pulses, or the share of the time inverted"))
            }
            (Some(_), Some(value)) => Err((value.span(), "expected either period or value, not both".to_owned())),
        }
    }

    fn fault(&self) -> Result<BoardFault, Complaint> {
        Ok(match self.kind.get_ref().as_str() {
            "crash" => BoardFault::Crash,
            "hang" => BoardFault::Hang,
            "reset" => BoardFault::Reset,
            "power-off" | "brown-out" => BoardFault::PowerOff,
            "slow" => BoardFault::Slow(self.time("how long the firmware takes over everything")?),
            "clock" => {
                let ppb = self.ratio(-200_000_000, 200_000_000, "the oscillator's error, -20 % to 20 %")?;
                BoardFault::Clock(Clock::from_ppb(ppb as i32).unwrap_or(Clock::TRUE))
            }
            "drift" => {
                BoardFault::Drift(self.ratio(-10_000_000, 10_000_000, "the drift a second, -1 % to 1 %")? as i32)
            }
            "counts" => BoardFault::Counts(self.integer(-1_000_000, 1_000_000, "so many counts")? as i32),
            "stall" => BoardFault::Stall,
            "load" => {
                let load = self.ratio(0, 2_000_000_000, "the share of the torque at standstill, 0 % to 200 %")?;
                BoardFault::Load((load / 1_000_000) as i32)
            }
            "supply" => {
                let supply = self.ratio(0, 2_000_000_000, "the share of the nominal supply, 0 % to 200 %")?;
                BoardFault::Supply((supply / 1_000_000) as u16)
            }
            "backlash" => BoardFault::Backlash(self.integer(0, i64::from(u16::MAX), "so many counts")? as u16),
            "end-stop" => {
                let what = "counts from mid-travel, on the side that the sign says";
                match self.integer(-10_000_000, 10_000_000, what)? {
                    0 => return Err((self.value(what)?.span(), format!("0 is on neither side: expected {what}"))),
                    counts => BoardFault::EndStop(counts as i32),
                }
            }
            "push" => {
                let push =
                    self.ratio(-2_000_000_000, 2_000_000_000, "the share of the holding torque, -200 % to 200 %")?;
                BoardFault::Push((push / 1_000_000) as i32)
            }
            "slip" => BoardFault::Slip(self.integer(-1_000_000, 1_000_000, "so many electrical turns")? as i32),
            "skip" => BoardFault::Skip(self.integer(1, 1_000_000_000, "in how many pulses one is lost")? as u32),
            "shift" => BoardFault::Shift((1e3 * self.length("so many mm, -1000 to 1000")?).round() as i32),
            "swap" => BoardFault::Swap,
            "dead" => {
                let what = "the encoder's channel, \"A\" or \"B\"";
                let value = self.value(what)?;
                match text_of(value).as_str() {
                    "A" => BoardFault::Dead(Channel::A),
                    "B" => BoardFault::Dead(Channel::B),
                    found => return Err((value.span(), format!("expected {what}, found '{found}'"))),
                }
            }
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
        let text = text_of(value);
        parse_span(&text).map_err(|message| (value.span(), format!("{what}: {message}")))
    }

    fn ratio(&self, least: i64, most: i64, what: &str) -> Result<i64, Complaint> {
        let value = self.value(what)?;
        let text = text_of(value);
        let found = parse_ratio(&text).map_err(|message| (value.span(), format!("{what}: {message}")))?;
        if (least..=most).contains(&found) {
            Ok(found)
        } else {
            Err((value.span(), format!("'{text}': expected {what}")))
        }
    }

    /// In mm; a number without a unit is mm.
    fn length(&self, what: &str) -> Result<f64, Complaint> {
        let value = self.value(what)?;
        let text = text_of(value);
        let found = text.parse().map_or_else(|_| parse_length(&text), Ok);
        let found = found.map_err(|message| (value.span(), format!("{what}: {message}")))?;
        let fits = (-1_000.0..=1_000.0).contains(&found);
        if fits { Ok(found) } else { Err((value.span(), format!("'{text}': expected {what}"))) }
    }

    fn integer(&self, least: i64, most: i64, what: &str) -> Result<i64, Complaint> {
        whole(self.value(what)?, least, most, what)
    }
}

/// A text as it is, anything else as the file writes it.
fn text_of(value: &Spanned<Value>) -> String {
    value.get_ref().as_str().map_or_else(|| value.get_ref().to_string(), str::to_owned)
}

fn whole(value: &Spanned<Value>, least: i64, most: i64, what: &str) -> Result<i64, Complaint> {
    let found = value.get_ref().as_integer().filter(|found| (least..=most).contains(found));
    let most = if most == i64::MAX { String::new() } else { format!(", {least} to {most}") };
    found.ok_or_else(|| (value.span(), format!("expected {what}{most}, found {}", value.get_ref())))
}

/// The text, or if it is a range, a value from it by lot.
///
/// # Errors
/// Where, and what was expected.
pub(crate) fn text_drawn(text: &Spanned<String>, place: &str, dice: &mut Dice) -> Result<Spanned<String>, Complaint> {
    match Quantities::parse(text.get_ref()) {
        None => Ok(text.clone()),
        Some(Ok(range)) => Ok(Spanned::new(text.span(), dice.draw(place, &range))),
        Some(Err(message)) => Err((text.span(), message)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::file::RigFile;

    #[test]
    fn every_kind_of_fault_is_offered_with_values_that_are_taken() {
        let names = |rig: &str| RigFile::load(rig).unwrap().names();
        let (lathe, engraver) = (names("lathe"), names("engraver"));
        let kinds = fault_kinds();
        assert_eq!(kinds.len(), LINE_KINDS.len() + BOARD_KINDS.len());
        for mut fault in kinds {
            // The other line cannot be known.
            fault.fields.iter_mut().filter(|(field, _)| *field == "with").for_each(|with| with.1 = "master_to_depth");
            let (names, place) = match (fault.line, fault.needs) {
                (true, _) => (&lathe, "pc_to_master"),
                (false, Some(Capability::Stepper)) => (&engraver, "engraver.x"),
                (false, _) => (&lathe, "transverse"),
            };
            let raw = fault.raw(place).unwrap();
            assert!(raw.plan(names, &mut Dice::new(0)).is_ok(), "{fault:?}");
        }
        let needs = |kind: &str| fault_kinds().into_iter().find(|fault| fault.kind == kind).unwrap().needs;
        assert_eq!(needs("stall"), Some(Capability::Motor));
        assert_eq!((needs("end-stop"), needs("hang"), needs("cut")), (Some(Capability::Axis), None, None));
    }
}
