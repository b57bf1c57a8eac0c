//! The rig file: which boards and links make a rig (TOML).

use std::path::Path;

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use torno_protocol::board::{Board as _, Description, Role};
use torno_protocol::clock::Clock;
use torno_protocol::layout::{BoardLayout, GATEWAY, Layout, LineLayout};
use torno_protocol::time::Span;
use torno_protocol::uart::{BITS_PER_CHARACTER, Receiver, ReceiverKind};

use super::{before, place};
use crate::text_file::TextError;
use torno_bus::{Dialect, Names, PcUart};
use torno_engine::NodeId;
use torno_machines::kinds::{self, KindError};
use torno_machines::workpiece::{Part, RawPart};
use torno_machines::{Axes, axes, with_axes};
use torno_port::Transport;
use torno_text::{Complaint, Invalid, nearest};
use torno_trace::Header;

/// The rig that is meant where none is named.
pub const DEFAULT: &str = "lathe";

/// A rig, as its file describes it; everything in it has been checked.
#[derive(Clone, Debug)]
pub struct RigFile {
    /// The rig's name.
    pub name: String,
    /// The PC's gateway: the first one.
    pub pc: Gateway,
    /// The other gateways, in the order of the file.
    pub more: Vec<Gateway>,
    /// The boards, in the order of the file.
    pub boards: Vec<Board>,
    /// What the rig consists of, the PC's UART included.
    pub layout: Layout,
    /// The part that it turns, if it does.
    pub part: Option<Part>,
    /// The file's text.
    pub text: String,
}

/// A gateway joins a port of a board to the world outside: a UART, and the dialect of its line.
#[derive(Clone, Debug)]
pub struct Gateway {
    /// Its name, unique among gateways and boards. `pc` for the `[pc]` of a file.
    pub name: String,
    /// What is said on its line. Default: the rig's dialect.
    pub dialect: &'static dyn Dialect,
    /// The board's place in [`RigFile::boards`], and its port.
    pub to: (usize, u8),
    /// Bits per second, 50…4 000 000. Default 9600.
    pub baud: u32,
    /// Characters that the UART has loaded beyond the one on the line, and that still go out after `XOFF`. 1…64,
    /// default 1.
    pub tx_fifo: usize,
    /// The error of its clock. Default 0.
    pub clock: Clock,
    /// What the first program that opens the port does to the board. Default: nothing.
    pub open: Opening,
    /// By what programs outside reach it. Default: a pty.
    pub transport: Transport,
}

/// What opening a port does to the board behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Opening {
    /// The board restarts, as by the DTR line of many a USB board.
    Reset,
    /// Nothing.
    #[default]
    Keep,
}

impl Gateway {
    /// The UART at the harness's side.
    pub fn uart(&self) -> PcUart {
        PcUart::new(self.baud, self.tx_fifo, self.clock)
    }
}

/// A board of the rig.
#[derive(Clone, Debug)]
pub struct Board {
    /// Its name, unique in the rig.
    pub name: String,
    /// Its kind: see [`kinds::names`].
    pub kind: String,
    /// Its oscillator.
    pub clock: Clock,
    /// Its settings, as TOML.
    pub settings: String,
    /// What it consists of.
    pub description: Description,
    /// The receiver of each port.
    pub receivers: Vec<ReceiverKind>,
    /// Its place is left open for a board by hand, by commands that can wait for one.
    pub awaited: bool,
}

/// Why a rig cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum RigFileError {
    /// The file cannot be read.
    #[error("cannot read the rig file '{path}' (built-in rigs: {})", built_in_names().join(", "))]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not text.
    #[error("{path}:{line}: expected text (UTF-8)")]
    NotText {
        /// The file.
        path: String,
        /// From 1.
        line: usize,
    },
    /// The file is not TOML, or not a rig.
    #[error(transparent)]
    Invalid(#[from] Invalid),
}

/// The names of the rigs that are built in.
pub fn built_in_names() -> Vec<&'static str> {
    torno_machines::rigs().map(|(name, _)| name).collect()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawRig {
    name: Spanned<String>,
    dialect: Spanned<String>,
    pc: Option<RawPc>,
    #[serde(default)]
    gateway: Vec<RawGateway>,
    #[serde(default)]
    board: Vec<RawBoard>,
    #[serde(default)]
    link: Vec<RawLink>,
    part: Option<RawPart>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPc {
    port: Spanned<String>,
    #[serde(default = "default_baud")]
    baud: Spanned<u32>,
    #[serde(default = "default_fifo")]
    tx_fifo: Spanned<usize>,
    #[serde(default = "default_ppm")]
    clock_ppm: Spanned<f64>,
    #[serde(default)]
    open: Opening,
    #[serde(default)]
    transport: Transport,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawGateway {
    name: Spanned<String>,
    port: Spanned<String>,
    dialect: Option<Spanned<String>>,
    #[serde(default = "default_baud")]
    baud: Spanned<u32>,
    #[serde(default = "default_fifo")]
    tx_fifo: Spanned<usize>,
    #[serde(default = "default_ppm")]
    clock_ppm: Spanned<f64>,
    #[serde(default)]
    open: Opening,
    #[serde(default)]
    transport: Transport,
}

impl From<RawPc> for RawGateway {
    fn from(RawPc { port, baud, tx_fifo, clock_ppm, open, transport }: RawPc) -> Self {
        let name = Spanned::new(port.span(), GATEWAY.to_owned());
        Self { name, port, dialect: None, baud, tx_fifo, clock_ppm, open, transport }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawBoard {
    name: Spanned<String>,
    kind: Spanned<String>,
    #[serde(default = "default_ppm")]
    clock_ppm: Spanned<f64>,
    #[serde(default, rename = "await")]
    awaited: bool,
    #[serde(default)]
    settings: toml::Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawLink {
    // Not an array of two, which would leave out a third without a word.
    ends: Spanned<Vec<Spanned<String>>>,
    dialect: Option<Spanned<String>>,
}

fn default_baud() -> Spanned<u32> {
    Spanned::new(0..0, 9600)
}

fn default_fifo() -> Spanned<usize> {
    Spanned::new(0..0, 1)
}

fn default_ppm() -> Spanned<f64> {
    Spanned::new(0..0, 0.0)
}

impl RigFile {
    /// The rig of that name, or in that file.
    ///
    /// # Errors
    /// [`RigFileError`]: where, what was expected, what was found.
    pub fn load(rig: &str) -> Result<Self, RigFileError> {
        if let Some((name, text)) = torno_machines::rigs().find(|(name, _)| *name == rig) {
            return Self::parse(name, text);
        }
        let path = rig.to_owned();
        match crate::text_file::read(Path::new(rig)) {
            Ok(text) => Self::parse(rig, &text),
            Err(TextError::Unreadable(source)) => Err(RigFileError::Unreadable { path, source }),
            Err(TextError::NotText { line }) => Err(RigFileError::NotText { path, line }),
        }
    }

    /// Reads a rig file's text. `path` is for the messages.
    ///
    /// # Errors
    /// [`RigFileError::Invalid`].
    pub fn parse(path: &str, text: &str) -> Result<Self, RigFileError> {
        let invalid = |(span, message): Complaint| Invalid::at(path, text, span, message);
        let of_toml = |error: toml::de::Error| invalid(torno_text::of_toml(&error));
        let table = DeTable::parse(text).map_err(of_toml)?;
        let raw = RawRig::deserialize(toml::Deserializer::from(table.clone())).map_err(of_toml)?;
        let file = Self::check(raw, table.get_ref()).map_err(invalid)?;
        Ok(Self { text: text.to_owned(), ..file })
    }

    /// The rig with `value` at `place`, as a command line says it: see [`place::set`].
    ///
    /// # Errors
    /// What is wrong with the place or the value.
    pub fn with(&self, place: &str, value: &str) -> Result<Self, String> {
        self.with_value(place, place::parsed(value))
    }

    /// The same with a value of any type.
    ///
    /// # Errors
    /// As there.
    pub fn with_value(&self, place: &str, value: toml::Value) -> Result<Self, String> {
        let mut table: toml::Table = toml::from_str(&self.text).map_err(|error| error.message().to_owned())?;
        place::set(&mut table, place, value)?;
        let text = toml::to_string(&table).map_err(|error| error.to_string())?;
        // Whoever gave a value on the command line has no use for its line in a file that there is not.
        Self::parse(&self.name, &text).map_err(|error| match error {
            RigFileError::Invalid(invalid) => invalid.message,
            error => error.to_string(),
        })
    }

    /// The same from `PLACE=VALUE`.
    ///
    /// # Errors
    /// As there.
    pub fn set(&self, text: &str) -> Result<Self, String> {
        let (place, value) = text.split_once('=').ok_or("expected PLACE=VALUE")?;
        self.with(place.trim(), value.trim())
    }

    /// The layout of the rig with this text, which was named `path`, and the text with the defaults spelled out that
    /// were others when version 3 of the trace's format was written; none if it is no rig.
    pub fn layout_of(path: &str, text: &str) -> Option<(Layout, String)> {
        let text = before::spelled_out(text)?;
        Self::parse(path, &text).ok().map(|file| (file.layout, text))
    }

    /// The names of its parts.
    pub fn names(&self) -> Names {
        Names::of(&self.layout, self.pc.dialect)
    }

    /// What tells the state of the board at the PC's port, if it is a controller: the board, and the quantity's number.
    pub fn state(&self) -> Option<(NodeId, u8)> {
        let node = self.pc.to.0;
        let mut signals = (0u8..).zip(&self.boards[node].description.signals);
        signals.find(|(_, signal)| signal.role == Role::State).map(|(signal, _)| (node, signal))
    }

    /// What heads the trace of a session with this rig, which was named `rig`.
    pub fn header(&self, rig: &str, seed: u64, program: Option<&str>) -> Header {
        Header::new(self.layout.clone(), &self.text, rig, seed, program)
    }

    /// The gateways; the PC's is the first.
    pub fn gateways(&self) -> impl Iterator<Item = &Gateway> {
        [&self.pc].into_iter().chain(&self.more)
    }

    /// Longer than a character takes on any line: two at the slowest speed, as no clock is wrong by half.
    pub fn margin(&self) -> Span {
        let slowest = self.layout.lines.iter().map(|line| line.baud).min().unwrap_or(self.pc.baud);
        Span::from_nanos(2 * BITS_PER_CHARACTER * 1_000_000_000 / u64::from(slowest))
    }

    /// `table` is the file that `raw` was read from: it still knows where each setting stands.
    fn check(raw: RawRig, table: &DeTable<'_>) -> Result<Self, Complaint> {
        let dialect = find_dialect(&raw.dialect)?;
        check_name(&raw.name)?;
        let mut boards: Vec<Board> = Vec::new();
        let none = Spanned::new(0..0, DeValue::Table(DeTable::new()));
        for (place, raw) in raw.board.into_iter().enumerate() {
            let board = table.get("board").and_then(|boards| boards.get_ref().get(place));
            let settings = board.and_then(|board| board.get_ref().get("settings")).unwrap_or(&none);
            let board = check_board(raw, settings, &boards)?;
            boards.push(board);
        }
        // A controller has to know the axes that it moves. The settings have been checked.
        let axes: Vec<Axes> = boards.iter().filter_map(|board| axes(&board.kind, &board.settings).ok()).collect();
        for board in &mut boards {
            board.settings = with_axes(&board.kind, &board.settings, &axes);
        }
        let mut taken = Vec::new();
        let mut end = |end: &Spanned<String>| {
            let found = find_end(&boards, end)?;
            if taken.contains(&found) {
                return Err((end.span(), format!("port '{}' is already connected", end.get_ref())));
            }
            taken.push(found);
            Ok(found)
        };
        let mut gateways: Vec<Gateway> = Vec::new();
        for raw in raw.pc.map(RawGateway::from).into_iter().chain(raw.gateway) {
            check_name(&raw.name)?;
            let name = raw.name.get_ref().clone();
            let boards = boards.iter().map(|board| board.name.as_str());
            if gateways.iter().map(|gateway| gateway.name.as_str()).chain(boards).any(|other| other == name) {
                let message = format!("the name '{name}' is already taken: expected another for this gateway");
                return Err((raw.name.span(), message));
            }
            gateways.push(Gateway {
                name,
                dialect: raw.dialect.as_ref().map_or(Ok(dialect), find_dialect)?,
                to: end(&raw.port)?,
                baud: in_range("baud", &raw.baud, 50..=4_000_000)?,
                tx_fifo: in_range("tx_fifo", &raw.tx_fifo, 1..=64)?,
                clock: check_clock(&raw.clock_ppm)?,
                open: raw.open,
                transport: raw.transport,
            });
        }
        let mut gateways = gateways.into_iter();
        let Some(pc) = gateways.next() else {
            return Err((raw.name.span(), "no way in from outside: expected a [pc] or a [[gateway]]".to_owned()));
        };
        let more: Vec<Gateway> = gateways.collect();
        let mut links: Vec<Link> = Vec::new();
        for RawLink { ends, dialect: own } in raw.link {
            let dialect = own.as_ref().map_or(Ok(dialect), find_dialect)?;
            let span = ends.span();
            let [a, b] = ends.get_ref().as_slice() else {
                return Err((span, format!("expected the two ends of a link, found {}", ends.get_ref().len())));
            };
            let (from, to) = (find_end(&boards, a)?.0, find_end(&boards, b)?.0);
            if from == to {
                let name = &boards[from].name;
                return Err((span, format!("'{name}' is linked to itself: expected ports of two different boards")));
            }
            let link = Link { ends: [end(a)?, end(b)?], dialect };
            let pair = |link: &Link| (link.ends[0].0.min(link.ends[1].0), link.ends[0].0.max(link.ends[1].0));
            if links.iter().any(|other| pair(other) == pair(&link)) {
                let [a, b] = link.ends.map(|(board, _)| &boards[board].name);
                return Err((
                    span,
                    format!("'{a}' and '{b}' are already linked: expected one link between two boards"),
                ));
            }
            links.push(link);
        }
        let name = raw.name.into_inner();
        let layout = layout([&pc].into_iter().chain(&more), &boards, &links);
        let mut file = Self { name, pc, more, boards, layout, part: None, text: String::new() };
        let carriage = |node: usize, motor: u8| {
            let Board { kind, settings, .. } = file.boards.get(node)?;
            kinds::carriage(kind, settings, motor).ok().flatten()
        };
        file.part = raw.part.map(|part| part.check(&file.names(), &carriage)).transpose()?;
        Ok(file)
    }
}

/// A link between two boards, each end a board's place and its port.
struct Link {
    ends: [(usize, u8); 2],
    dialect: &'static dyn Dialect,
}

/// Every line, in the order of the engine's numbers: both directions of each link, the gateways' first. The gateways'
/// UARTs come behind the boards and have one port.
fn layout<'a>(gateways: impl Iterator<Item = &'a Gateway> + Clone, boards: &[Board], links: &[Link]) -> Layout {
    let board = |board: &Board| BoardLayout {
        name: board.name.clone(),
        kind: board.kind.clone(),
        clock: board.clock,
        description: board.description.clone(),
        receivers: board.receivers.clone(),
    };
    let uart = |gateway: &Gateway| BoardLayout {
        name: gateway.name.clone(),
        kind: GATEWAY.to_owned(),
        clock: gateway.clock,
        description: gateway.uart().description(),
        receivers: gateway.uart().receivers().iter().map(Receiver::kind).collect(),
    };
    let count = boards.len();
    let boards: Vec<BoardLayout> = boards.iter().map(board).chain(gateways.clone().map(uart)).collect();
    let line = |from: (usize, u8), to: (usize, u8), baud: u32, dialect: &dyn Dialect| LineLayout {
        name: format!("{}_to_{}", boards[from.0].name, boards[to.0].name),
        from,
        to,
        baud,
        dialect: dialect.name().to_owned(),
    };
    let outside =
        (count..).zip(gateways).map(|(place, gateway)| ((place, 0), gateway.to, gateway.baud, gateway.dialect));
    let between = links.iter().map(|Link { ends: [a, b], dialect }| (*a, *b, dialect.baud(), *dialect));
    let both = |(a, b, baud, dialect)| [line(a, b, baud, dialect), line(b, a, baud, dialect)];
    let lines = outside.chain(between).flat_map(both).collect();
    Layout { boards, lines }
}

fn find_dialect(name: &Spanned<String>) -> Result<&'static dyn Dialect, Complaint> {
    torno_machines::dialect(name.get_ref()).ok_or_else(|| {
        let (name, span) = (name.get_ref(), name.span());
        (span, format!("unknown dialect '{name}'{}", nearest(name, &torno_machines::dialect_names())))
    })
}

fn check_name(name: &Spanned<String>) -> Result<(), Complaint> {
    let text = name.get_ref();
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-';
    if text.is_empty() || text.len() > 32 || !text.chars().all(fits) {
        let message = format!("'{text}': expected a name of 1 to 32 lower-case letters, digits, '-' or '_'");
        return Err((name.span(), message));
    }
    Ok(())
}

fn check_board(raw: RawBoard, settings: &Spanned<DeValue<'_>>, others: &[Board]) -> Result<Board, Complaint> {
    check_name(&raw.name)?;
    let name = raw.name.get_ref().clone();
    if name == "pc" {
        return Err((raw.name.span(), "the name 'pc' is the PC's: expected another for this board".to_owned()));
    }
    if others.iter().any(|board| board.name == name) {
        return Err((raw.name.span(), format!("the name '{name}' is already taken: expected another for this board")));
    }
    let clock = check_clock(&raw.clock_ppm)?;
    let kind = raw.kind.get_ref().clone();
    let stepper = kinds::build_parsed(&kind, settings, clock).map_err(|error| {
        let span = match &error {
            KindError::Settings { span, .. } => span.clone(),
            KindError::Unknown { .. } => raw.kind.span(),
        };
        (span, error.to_string())
    })?;
    let settings = toml::to_string(&raw.settings).map_err(|error| (settings.span(), error.to_string()))?;
    let (description, receivers) = (stepper.description(), stepper.receivers());
    Ok(Board { name, kind, clock, settings, description, receivers, awaited: raw.awaited })
}

fn check_clock(ppm: &Spanned<f64>) -> Result<Clock, Complaint> {
    let ppb = ppm.get_ref() * 1000.0;
    let clock = if ppb.is_finite() { Clock::from_ppb(ppb as i32) } else { None };
    clock.ok_or_else(|| (ppm.span(), format!("clock_ppm = {}: expected -200000 to 200000", ppm.get_ref())))
}

fn in_range<T: PartialOrd + Copy + std::fmt::Display>(
    name: &str,
    value: &Spanned<T>,
    range: std::ops::RangeInclusive<T>,
) -> Result<T, Complaint> {
    let found = *value.get_ref();
    if range.contains(&found) {
        return Ok(found);
    }
    Err((value.span(), format!("{name} = {found}: expected {} to {}", range.start(), range.end())))
}

fn find_end(boards: &[Board], end: &Spanned<String>) -> Result<(usize, u8), Complaint> {
    let complain = |message: String| Err((end.span(), message));
    let Some((board, port)) = end.get_ref().split_once('.') else {
        return complain(format!("'{}': expected board.port", end.get_ref()));
    };
    let Some(place) = boards.iter().position(|other| other.name == board) else {
        let known: Vec<&str> = boards.iter().map(|board| board.name.as_str()).collect();
        return complain(match known.join(", ") {
            known if board == "pc" => format!("the PC is linked by 'port' in [pc]: expected one of {known}"),
            known if known.is_empty() => format!("there is no board '{board}': expected a [[board]] of that name"),
            known => format!("there is no board '{board}': expected one of {known}"),
        });
    };
    let ports = &boards[place].description.ports;
    match ports.iter().position(|other| other == port) {
        Some(port) => Ok((place, port as u8)),
        None => complain(format!("board '{board}' has no port '{port}': expected one of {}", ports.join(", "))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATHE: &str = include_str!("../../builtin/lathe.toml");

    fn lathe_with(from: &str, to: &str) -> String {
        let text = LATHE;
        assert!(text.contains(from), "{from}");
        RigFile::parse("my.toml", &text.replacen(from, to, 1))
            .map(|_| "fine".to_owned())
            .unwrap_or_else(|e| e.to_string())
    }

    #[test]
    fn the_built_in_rigs_are_sound() {
        for name in built_in_names() {
            assert_eq!(RigFile::load(name).unwrap().name, name);
        }
    }

    #[test]
    fn complaints_about_settings_say_where_in_the_file() {
        // Where they may stand, and how far below `kind` and how far right each field then begins.
        type Place = (fn(&str) -> String, usize, usize);
        let places: [Place; 4] = [
            (|fields| format!("[board.settings.plant]\npitch_mm = 2.5\n{fields}"), 3, 1),
            (|fields| format!("clock_ppm = 5\nsettings.plant = {{ pitch_mm = 2.5, {fields} }}"), 2, 36),
            (|fields| format!("settings.plant.pitch_mm = 2.5\nsettings.plant.{fields}"), 2, 16),
            (|fields| format!("settings = {{ plant = {{\n  # (Ours.)\n\n  {fields},\n}} }}"), 4, 3),
        ];
        let kind = "kind = \"depth\"";
        let text = LATHE;
        let kind_line = text[..text.find(kind).unwrap()].matches('\n').count() + 1;
        let known = "tau_s, rpm, pitch_mm, travel_mm, backlash_mm, friction, load_torque";
        for (field, column, expected) in [
            ("rpn = 8", 0, "unknown field `rpn`: did you mean 'rpm'?".to_owned()),
            ("\"r p m\" = 8", 0, "unknown field `r p m`: did you mean 'rpm'?".to_owned()),
            ("poll_ms = 8", 0, "unknown field `poll_ms`: did you mean 'controller.poll_ms'?".to_owned()),
            ("rpm = 0", 6, "plant.rpm: expected 0.1 to 1000, found 0".to_owned()),
            ("rpm   = nan", 8, "plant.rpm: expected 0.1 to 1000, found NaN".to_owned()),
            ("rpm = \"8\"", 6, "invalid type: string \"8\", expected f64".to_owned()),
            ("rpm = { x = 8 }", 6, "invalid type: map, expected f64".to_owned()),
            ("rpm.x = 8", 0, "invalid type: map, expected f64".to_owned()),
            ("rpm = [1, 2]", 6, "invalid type: sequence, expected f64".to_owned()),
            ("pitch = 8", 0, "unknown field `pitch`: did you mean 'pitch_mm'?".to_owned()),
            ("law.gains = { k = 8 }", 0, format!("unknown field `law`: expected one of {known}")),
        ] {
            for (place, lines, columns) in places {
                let to = format!("{kind}\n{}", place(field));
                let expected =
                    format!("my.toml:{}:{}: settings of this depth: {expected}", kind_line + lines, columns + column);
                assert_eq!(lathe_with(kind, &to), expected, "{to}");
            }
        }
    }

    #[test]
    fn each_board_has_its_own_settings() {
        let own = [
            ("master", "answer_ms = 1", "answer_ms: expected 8 to 1000, found 1"),
            ("spindle", "controller.k = 1e3", "controller.k: "),
        ];
        for (kind, field, expected) in own {
            let from = format!("kind = \"{kind}\"");
            // The depth board's come later in the file, and are fine.
            let text = LATHE.replace("kind = \"depth\"", "kind = \"depth\"\nsettings.plant.rpm = 9");
            let text = text.replace(&from, &format!("{from}\nsettings.{field}"));
            let found = RigFile::parse("my.toml", &text).unwrap_err().to_string();
            let line = text[..text.find(field).unwrap()].matches('\n').count() + 1;
            assert!(found.starts_with(&format!("my.toml:{line}:")) && found.contains(expected), "{found}");
        }
    }

    #[test]
    fn complaints_say_where_and_what_was_expected() {
        for (from, to, expected) in [
            ("kind = \"spindle\"", "kind = \"spindel\"", "my.toml:18:8: unknown kind of board 'spindel'"),
            ("baud = 9600", "baud = 9", "my.toml:8:8: baud = 9: expected 50 to 4000000"),
            (
                "\"master.depth\"",
                "\"master.deep\"",
                "has no port 'deep': expected one of pc, spindle, transverse, depth",
            ),
            ("\"depth.master\"", "\"depht.master\"", "there is no board 'depht': expected one of master, spindle"),
            ("\"master.depth\"", "\"master.spindle\"", "port 'master.spindle' is already connected"),
            ("name = \"depth\"", "name = \"spindle\"", "the name 'spindle' is already taken"),
            (
                "\"master.depth\", \"depth.master\"",
                "\"master.depth\", \"master.transverse\"",
                "my.toml:LINE:8: 'master' is linked to itself: expected ports of two different boards",
            ),
            (
                "\"spindle.master\"",
                "\"master.spindle\"",
                "my.toml:LINE:8: 'master' is linked to itself: expected ports of two different boards",
            ),
            (
                "\"depth.master\"",
                "\"pc.cable\"",
                "my.toml:LINE:25: the PC is linked by 'port' in [pc]: expected one of master, spindle, ",
            ),
            ("\"depth.master\"", "\"depth\"", "my.toml:LINE:25: 'depth': expected board.port"),
            ("\"depth.master\"", "\"depth.mister\"", "my.toml:LINE:25: board 'depth' has no port 'mister': expected"),
            ("\"depth.master\"", "\"depht.master\"", "my.toml:LINE:25: there is no board 'depht': expected one of"),
            ("\"depth.master\"", "\"spindle.master\"", "my.toml:LINE:25: port 'spindle.master' is already connected"),
            ("\"master.depth\"", "\"master.pc\"", "my.toml:LINE:9: port 'master.pc' is already connected"),
            (
                "\"master.depth\", \"depth.master\"",
                "\"master.depth\"",
                "my.toml:LINE:8: expected the two ends of a link, found 1",
            ),
            (
                "\"depth.master\"]",
                "\"depth.master\", \"a.b\"]",
                "my.toml:LINE:8: expected the two ends of a link, found 3",
            ),
            ("name = \"depth\"", "name = \"spindle\"", "my.toml:LINE:8: the name 'spindle' is already taken: expected"),
            (
                "name = \"depth\"",
                "name = \"pc\"",
                "my.toml:LINE:8: the name 'pc' is the PC's: expected another for this board",
            ),
            ("port = \"master.pc\"", "port = \"mister.pc\"", "my.toml:LINE:8: there is no board 'mister': expected"),
            ("port = \"master.pc\"", "port = \"master.usb\"", "my.toml:LINE:8: board 'master' has no port 'usb': "),
            ("port = \"master.pc\"", "port = \"pc.cable\"", "my.toml:LINE:8: the PC is linked by 'port'"),
            ("tx_fifo", "tx_fivo", "my.toml:9:1: unknown field `tx_fivo`: did you mean 'tx_fifo'?"),
            ("kind = \"depth\"", "kind = \"depth\"\n[board.settings]\npitch_mm = 1", "did you mean 'plant.pitch_mm'?"),
            (
                "kind = \"spindle\"",
                "kind = \"spindle\"\nsettings.controller.form = \"litteral\"",
                "my.toml:19:28: settings of this spindle: unknown variant `litteral`: did you mean 'literal'?",
            ),
            (
                "kind = \"depth\"",
                "kind = \"depth\"\nsettings.controller.poll_ms = -1",
                "invalid value: integer `-1`, expected u32",
            ),
            (
                "kind = \"depth\"",
                "kind = \"depth\"\nsettings.encoder.slots = 900.5",
                "invalid type: floating point `900.5`, expected u32",
            ),
            ("[pc]", "[pc", "my.toml:6:4:"),
        ] {
            let line = LATHE.split(from).next().unwrap().matches('\n').count() + 1;
            let expected = &expected.replace("LINE", &line.to_string());
            let found = lathe_with(from, to);
            assert!(found.contains(expected), "{found}\nlacks\n{expected}");
        }
    }

    #[test]
    fn a_value_from_elsewhere_takes_its_place_or_is_complained_about() {
        let rig = RigFile::load("lathe").unwrap();
        let settings = |rig: &RigFile, board: usize| rig.boards[board].settings.clone();
        let changed = rig.with("spindle.controller.k", "0.25").unwrap().with("depth.plant.rpm", "9").unwrap();
        assert_eq!(
            (settings(&changed, 1), settings(&changed, 3)),
            ("[controller]\nk = 0.25\n".into(), "[plant]\nrpm = 9\n".into())
        );
        assert_eq!(
            rig.with("board.spindle.settings.controller.k", "0.25").unwrap().boards[1].settings,
            settings(&changed, 1)
        );
        assert_eq!(rig.with("pc.baud", "4800").unwrap().pc.baud, 4_800);
        assert_eq!(rig.with("depth.clock_ppm", "5").unwrap().boards[3].clock, Clock::from_ppb(5_000).unwrap());
        for (place, value, expected) in [
            ("spindel.controller.k", "1", "there is no board 'spindel': did you mean 'spindle'?"),
            ("spindle.contoller.k", "1", "unknown field `contoller`: did you mean 'controller'?"),
            ("spindle.controller.ka", "1", "settings of this spindle: unknown field `ka`: did you mean 'k'?"),
            ("spindle.k", "1", "settings of this spindle: unknown field `k`: did you mean 'controller.k'?"),
            ("spindle.plant.km", "1", "unknown field `km`: did you mean 'km_rad_per_s_volt'?"),
            ("spindle.controller.k", "-1", "settings of this spindle: controller.k: expected 0 to 100, found -1"),
            ("spindle.controller.k", "x", "invalid type: string \"x\", expected f64"),
            ("spindle.controller", "1", "expected struct SpindleController"),
            ("spindle", "1", "expected a field after it"),
            ("pc.boud", "1", "unknown field `boud`: did you mean 'baud'?"),
            ("spindle.clock_pmm", "1", "unknown field `clock_pmm`: did you mean 'clock_ppm'?"),
        ] {
            let found = rig.with(place, value).unwrap_err();
            assert!(found.contains(expected), "{place}: {found}");
        }
    }

    #[test]
    fn a_rig_without_boards_is_none() {
        let text = "name = \"bare\"\ndialect = \"lathe\"\n[pc]\nport = \"master.pc\"\n";
        let found = RigFile::parse("my.toml", text).unwrap_err().to_string();
        assert_eq!(found, "my.toml:4:8: there is no board 'master': expected a [[board]] of that name");
    }
}
