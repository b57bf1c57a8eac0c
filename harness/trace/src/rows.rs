//! What of a trace is shown, as a bus analyser would: one row for each thing that happened.

use std::fmt::Write;

use anstyle::{AnsiColor, Style};
use serde_json::{Value, json};
use torno_protocol::board::{Description, MotorStimulus, PinOutput, Stimulus, event_text};
use torno_protocol::line::Level;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;

use super::Header;
use torno_bus::{LineCharacter, Message, hex};
use torno_engine::{Disturbance, Fact, Input, InputKind, LineId, NodeId, Tampering};

/// Bytes of one write that are shown.
const SHOWN: usize = 16;

/// The kinds of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Changes of a line's level.
    Edges,
    /// Characters on a line.
    Characters,
    /// Frames, parts and replies.
    Frames,
    /// Quantities of boards.
    Telemetry,
    /// What boards tell.
    Events,
    /// What came from outside.
    Inputs,
    /// What output pins do.
    Pins,
}

impl Kind {
    const NAMES: [(Self, &'static str); 7] = [
        (Self::Edges, "edges"),
        (Self::Characters, "characters"),
        (Self::Frames, "frames"),
        (Self::Telemetry, "telemetry"),
        (Self::Events, "events"),
        (Self::Inputs, "inputs"),
        (Self::Pins, "pins"),
    ];

    /// The kinds that are shown if none is asked for: all but edges.
    const USUAL: [Self; 6] = [Self::Characters, Self::Frames, Self::Telemetry, Self::Events, Self::Inputs, Self::Pins];

    fn name(self) -> &'static str {
        Self::NAMES.iter().find(|row| row.0 == self).map_or("?", |row| row.1)
    }
}

/// What is asked for, in words.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    /// Nothing before this instant.
    pub from: Instant,
    /// Nothing after this instant, if any.
    pub to: Option<Instant>,
    /// These lines. If there are none, and no boards: all.
    pub lines: Vec<String>,
    /// These boards. If there are none, and no lines: all.
    pub boards: Vec<String>,
    /// These kinds of rows; if there are none, all but edges.
    pub kinds: Vec<String>,
}

/// There is nothing of that name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown {what} '{name}'{nearest}")]
pub struct UnknownName {
    what: &'static str,
    name: String,
    nearest: String,
}

/// What is shown of a trace.
#[derive(Clone, Debug)]
pub struct Filter {
    from: Instant,
    to: Instant,
    lines: Vec<bool>,
    boards: Vec<bool>,
    pub(super) kinds: Vec<Kind>,
}

impl Filter {
    /// What is wanted, of a rig like this.
    ///
    /// # Errors
    /// [`UnknownName`] with the nearest that there is.
    pub fn new(header: &Header, wanted: &Wanted) -> Result<Self, UnknownName> {
        let lines: Vec<&str> = header.layout.lines.iter().map(|line| line.name.as_str()).collect();
        let boards: Vec<&str> = header.layout.boards.iter().map(|board| board.name.as_str()).collect();
        let everything = wanted.lines.is_empty() && wanted.boards.is_empty();
        let kinds = chosen("kind", &Kind::NAMES.map(|row| row.1), &wanted.kinds)?;
        let kinds: Vec<Kind> =
            Kind::NAMES.iter().zip(kinds).filter(|(_, chosen)| *chosen).map(|(row, _)| row.0).collect();
        Ok(Self {
            from: wanted.from,
            to: wanted.to.unwrap_or(Instant::NEVER),
            lines: chosen("line", &lines, &wanted.lines)?.into_iter().map(|chosen| chosen || everything).collect(),
            boards: chosen("board", &boards, &wanted.boards)?.into_iter().map(|chosen| chosen || everything).collect(),
            kinds: if kinds.is_empty() { Kind::USUAL.to_vec() } else { kinds },
        })
    }

    /// Whether a row is shown.
    pub(super) fn shows(&self, row: &Row) -> bool {
        let place = match row.place {
            RowPlace::Line(line) => self.lines[line],
            RowPlace::Board(board) => self.boards[board],
        };
        place && self.kinds.contains(&row.kind()) && self.from <= row.at && row.at <= self.to
    }
}

/// Which of the known names are among those asked for.
fn chosen(what: &'static str, known: &[&str], asked: &[String]) -> Result<Vec<bool>, UnknownName> {
    if let Some(name) = asked.iter().find(|name| !known.contains(&name.as_str())) {
        return Err(UnknownName { what, name: name.clone(), nearest: torno_text::nearest(name, known) });
    }
    Ok(known.iter().map(|known| asked.iter().any(|name| name == known)).collect())
}

/// Where something happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowPlace {
    /// On a line.
    Line(LineId),
    /// On a board.
    Board(NodeId),
}

impl RowPlace {
    /// Its name.
    pub fn name(self, header: &Header) -> &str {
        match self {
            Self::Line(line) => &header.layout.lines[line].name,
            Self::Board(board) => &header.layout.boards[board].name,
        }
    }
}

/// One thing that happened.
#[derive(Clone, Debug)]
pub struct Row {
    /// When.
    pub at: Instant,
    /// Where.
    pub place: RowPlace,
    content: Content,
}

#[derive(Clone, Debug)]
enum Content {
    Edge(Level),
    Character(Character),
    Message { text: String, flaw: bool },
    Telemetry { quantity: String, value: i64 },
    Event { text: String },
    Input { text: String },
    Pin { text: String },
}

impl Row {
    /// What kind of row it is.
    pub fn kind(&self) -> Kind {
        match self.content {
            Content::Edge(_) => Kind::Edges,
            Content::Character(_) => Kind::Characters,
            Content::Message { .. } => Kind::Frames,
            Content::Telemetry { .. } => Kind::Telemetry,
            Content::Event { .. } => Kind::Events,
            Content::Input { .. } => Kind::Inputs,
            Content::Pin { .. } => Kind::Pins,
        }
    }

    /// A row for a character.
    pub fn character(heard: &LineCharacter) -> Self {
        Self { at: heard.at, place: RowPlace::Line(heard.line), content: Content::Character(heard.character) }
    }

    /// A row for a message.
    pub(super) fn message(message: Message) -> Self {
        let Message { at, line, text, flaw } = message;
        Self { at, place: RowPlace::Line(line), content: Content::Message { text, flaw } }
    }

    /// Rows for a fact: one for each edge, or one.
    pub fn of_fact(header: &Header, fact: &Fact) -> Vec<Self> {
        let description = |node: NodeId| &header.layout.boards[node].description;
        match fact {
            Fact::Edges { line, edges } => edges
                .iter()
                .map(|edge| Self { at: edge.at, place: RowPlace::Line(*line), content: Content::Edge(edge.level) })
                .collect(),
            Fact::Telemetry { node, at, signal, value } => {
                let signal = description(*node).signals.get(usize::from(*signal));
                let quantity = signal.map_or_else(|| "?".to_owned(), |signal| signal.name.clone());
                let content = Content::Telemetry { quantity, value: *value };
                vec![Self { at: *at, place: RowPlace::Board(*node), content }]
            }
            Fact::Event { node, at, event, value } => {
                let text = description(*node).events.get(usize::from(*event));
                let text = text.map_or_else(|| format!("event {event}, {value}"), |text| event_text(text, *value));
                vec![Self { at: *at, place: RowPlace::Board(*node), content: Content::Event { text } }]
            }
            Fact::Pin { node, at, pin, what } => {
                let known = description(*node).pins.get(usize::from(*pin));
                let name = known.map_or("?", |pin| pin.name.as_str());
                let content = Content::Pin { text: format!("{name}: {}", output_text(*what)) };
                vec![Self { at: *at, place: RowPlace::Board(*node), content }]
            }
        }
    }

    /// A row for what came from outside.
    pub(super) fn of_input(header: &Header, input: &Input) -> Self {
        let (place, text) = match &input.what {
            InputKind::Stimulus { board, stimulus } => {
                (RowPlace::Board(*board), stimulus_text(&header.layout.boards[*board].description, stimulus))
            }
            InputKind::Disturbed { line, fault, disturbance } => {
                (RowPlace::Line(*line), format!("fault {fault}: {}", disturbance_text(header, disturbance)))
            }
            InputKind::Healed { line, fault } => (RowPlace::Line(*line), format!("fault {fault} ends")),
            InputKind::Stopped { board, .. } => (RowPlace::Board(*board), "process stopped: hangs".to_owned()),
            InputKind::Continued { board } => (RowPlace::Board(*board), "process continued".to_owned()),
            InputKind::Died { board, .. } => (RowPlace::Board(*board), "process died".to_owned()),
        };
        Self { at: input.at, place, content: Content::Input { text } }
    }

    /// Whether something is wrong on a line.
    pub fn is_flaw(&self) -> bool {
        match &self.content {
            Content::Character(character) => character.ok().is_none(),
            Content::Message { flaw, .. } => *flaw,
            _ => false,
        }
    }

    /// What happened, in words.
    pub fn what(&self) -> String {
        match &self.content {
            Content::Edge(Level::High) => "high".to_owned(),
            Content::Edge(Level::Low) => "low".to_owned(),
            Content::Character(character) => {
                let mut text = format!("{:02X}", character.byte);
                if let Some(name) = character_name(character.byte) {
                    write!(text, "  {name}").ok();
                }
                if let Some(error) = error_name(*character) {
                    write!(text, "  !{error}").ok();
                }
                text
            }
            Content::Message { text, .. }
            | Content::Event { text }
            | Content::Input { text }
            | Content::Pin { text } => text.clone(),
            Content::Telemetry { quantity, value } => format!("{quantity} = {value}"),
        }
    }

    /// The row for people: time in seconds, place, kind and what; without a line feed.
    pub fn text(&self, header: &Header, colour: bool) -> String {
        let nanos = self.at.as_nanos();
        let (seconds, rest) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
        let (mark, style) = match &self.content {
            _ if self.is_flaw() => ("!", AnsiColor::Red.on_default().bold()),
            Content::Message { .. } => (">", AnsiColor::Cyan.on_default()),
            Content::Telemetry { .. } => ("=", Style::new().dimmed()),
            Content::Pin { .. } => ("~", Style::new().dimmed()),
            Content::Event { .. } => ("*", Style::new()),
            Content::Input { .. } => ("<", AnsiColor::Yellow.on_default()),
            Content::Edge(_) | Content::Character(_) => (" ", Style::new()),
        };
        let style = if colour { style } else { Style::new() };
        let place = self.place.name(header);
        format!("{seconds:>5}.{rest:09}  {place:<22} {style}{mark} {}{style:#}", self.what())
    }

    /// The row for programs. `ns` is in nanoseconds.
    pub fn json(&self, header: &Header) -> Value {
        let mut row = json!({ "ns": self.at.as_nanos(), "kind": self.kind().name() });
        let place = self.place.name(header);
        match self.place {
            RowPlace::Line(_) => row["line"] = place.into(),
            RowPlace::Board(_) => row["board"] = place.into(),
        }
        match &self.content {
            Content::Edge(level) => row["level"] = u8::from(*level == Level::High).into(),
            Content::Character(character) => {
                row["byte"] = character.byte.into();
                row["name"] = character_name(character.byte).into();
                row["error"] = error_name(*character).into();
            }
            Content::Message { text, flaw } => {
                row["text"] = text.as_str().into();
                row["flaw"] = (*flaw).into();
            }
            Content::Telemetry { quantity, value } => {
                row["quantity"] = quantity.as_str().into();
                row["value"] = (*value).into();
            }
            Content::Event { text } | Content::Input { text } | Content::Pin { text } => {
                row["text"] = text.as_str().into();
            }
        }
        row
    }

    /// The row as comma-separated values, if it is telemetry: time in seconds, board, quantity, value.
    pub fn csv(&self, header: &Header) -> Option<String> {
        let Content::Telemetry { quantity, value } = &self.content else { return None };
        let nanos = self.at.as_nanos();
        let (seconds, rest) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
        let fields = [self.place.name(header), quantity.as_str()].map(csv_field);
        Some(format!("{seconds}.{rest:09},{},{value}", fields.join(",")))
    }
}

/// The first line of the comma-separated values.
pub const CSV_HEADER: &str = "time_s,board,quantity,value";

/// A field as RFC 4180 has it.
fn csv_field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn output_text(what: PinOutput) -> String {
    match what {
        PinOutput::Level(Level::High) => "high".to_owned(),
        PinOutput::Level(Level::Low) => "low".to_owned(),
        PinOutput::Pulses(train) if train.count == 0 => "no pulses".to_owned(),
        PinOutput::Pulses(train) => format!("{} pulses at {:.1} Hz from {}", train.count, train.hz(), train.first),
    }
}

fn stimulus_text(description: &Description, stimulus: &Stimulus) -> String {
    match stimulus {
        Stimulus::Motor { motor, what } => match description.motor_name(*motor) {
            Some(name) => format!("{name}: {}", motor_stimulus_text(*what)),
            None => motor_stimulus_text(*what),
        },
        Stimulus::Stop(true) => "is stopped".to_owned(),
        Stimulus::Stop(false) => "goes on".to_owned(),
        Stimulus::Hang(true) => "hangs".to_owned(),
        Stimulus::Hang(false) => "runs on".to_owned(),
        Stimulus::Reset => "is reset".to_owned(),
        Stimulus::Write(bytes) if bytes.len() > SHOWN => {
            format!("writes {} ... ({} bytes)", hex(&bytes[..SHOWN]), bytes.len())
        }
        Stimulus::Write(bytes) => format!("writes {}", hex(bytes)),
        Stimulus::Discard => "discards what is not sent".to_owned(),
        Stimulus::Configure { baud, ixon } => {
            format!("sets {baud} baud, XON/XOFF {}", if *ixon { "on" } else { "off" })
        }
        Stimulus::Format(format) => format!("sets {format}"),
        Stimulus::Break(true) => "begins a break".to_owned(),
        Stimulus::Break(false) => "ends the break".to_owned(),
        Stimulus::Power(true) => "supply on".to_owned(),
        Stimulus::Power(false) => "supply off".to_owned(),
        Stimulus::Slow(Span::ZERO) => "is slow no more".to_owned(),
        Stimulus::Slow(by) => format!("takes {by} longer over everything"),
        Stimulus::Clock(clock) => format!("oscillator off by {} ppb", clock.error_ppb()),
    }
}

fn motor_stimulus_text(what: MotorStimulus) -> String {
    match what {
        MotorStimulus::Stall(true) => "shaft blocked".to_owned(),
        MotorStimulus::Stall(false) => "shaft free".to_owned(),
        MotorStimulus::Counts(counts) => format!("encoder jumps by {counts:+} counts"),
        MotorStimulus::Load(load) => format!("load on the motor {load} per mille"),
        MotorStimulus::Supply(supply) => format!("motor's supply {supply} per mille"),
        MotorStimulus::Backlash(counts) => format!("backlash {counts} counts"),
        MotorStimulus::EndStop(0) => "way free".to_owned(),
        MotorStimulus::EndStop(counts) => format!("end stop at {counts:+} counts"),
        MotorStimulus::Push(push) => format!("push on the carriage {push} per mille"),
        MotorStimulus::Slip(turns) => format!("rotor slips by {turns:+} electrical turns"),
        MotorStimulus::Skip(0) => "no pulse is lost".to_owned(),
        MotorStimulus::Skip(every) => format!("one pulse in {every} is lost"),
        MotorStimulus::Shift(um) => format!("carriage shifted by {um:+} um"),
        MotorStimulus::Swap(true) => "encoder's channels exchanged".to_owned(),
        MotorStimulus::Swap(false) => "encoder's channels right".to_owned(),
        MotorStimulus::Dead(Some(channel)) => format!("encoder's channel {channel:?} dead"),
        MotorStimulus::Dead(None) => "encoder's channels alive".to_owned(),
        MotorStimulus::Drive(0) => "service mode ends".to_owned(),
        MotorStimulus::Drive(drive) => format!("service mode: drive {drive} per mille"),
    }
}

fn disturbance_text(header: &Header, disturbance: &Disturbance) -> String {
    match disturbance {
        Disturbance::Cut => "is cut".to_owned(),
        Disturbance::Stuck(Level::Low) => "is stuck low".to_owned(),
        Disturbance::Stuck(Level::High) => "is stuck high".to_owned(),
        Disturbance::Short(other) => format!("touches {}", RowPlace::Line(*other).name(header)),
        Disturbance::Noise { period, width, seed } => {
            format!("noise, a pulse of up to {width} every {period}, seed {seed}")
        }
        Disturbance::Character { nth, what } => {
            let what = match what {
                Tampering::Flip(bit) => format!("has bit {bit} flipped"),
                Tampering::Delay { edge, by } => format!("has edge {edge} late by {by}"),
                Tampering::Drop => "is dropped".to_owned(),
                Tampering::Double => "comes twice".to_owned(),
            };
            format!("character {nth} from here {what}")
        }
    }
}

/// What is wrong with a character. One whose bits and stop bit are all low is a break, or the beginning of one.
fn error_name(character: Character) -> Option<&'static str> {
    match character {
        Character { byte: 0, framing_error: true, .. } => Some("break"),
        Character { framing_error: true, .. } => Some("framing"),
        Character { overrun: true, .. } => Some("overrun"),
        _ => None,
    }
}

/// The name of a control character (ITU-T T.50), or a printable one.
fn character_name(byte: u8) -> Option<String> {
    const CONTROL: [&str; 32] = [
        "NUL", "SOH", "STX", "ETX", "EOT", "ENQ", "ACK", "BEL", "BS", "HT", "LF", "VT", "FF", "CR", "SO", "SI", "DLE",
        "XON", "DC2", "XOFF", "DC4", "NAK", "SYN", "ETB", "CAN", "EM", "SUB", "ESC", "FS", "GS", "RS", "US",
    ];
    match byte {
        0..=31 => CONTROL.get(usize::from(byte)).map(|name| (*name).to_owned()),
        32..=126 => Some(format!("'{}'", char::from(byte))),
        127 => Some("DEL".to_owned()),
        _ => None,
    }
}
