//! The kinds of boards: the one place that knows what each is made of.

use std::ops::Range;

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};
use torno_master::{Master, MasterSettings};
use torno_protocol::board::{Board, Description};
use torno_protocol::clock::Clock;
use torno_protocol::record::{Batch, Turn};
use torno_protocol::stepping::{BrokenPromise, Stepper};
use torno_slaves::{Depth, DepthSettings, Spindle, SpindleSettings, Transverse, TransverseSettings};

/// The kinds of boards that there are.
pub const NAMES: [&str; 4] = ["master", "spindle", "transverse", "depth"];

/// A board of any kind with its stepper.
pub trait Steps: Send {
    /// What the board consists of.
    fn description(&self) -> Description;

    /// Takes a turn.
    ///
    /// # Errors
    /// See [`Stepper::turn`].
    fn turn(&mut self, turn: &Turn) -> Result<Batch, BrokenPromise>;
}

impl<B: Board + Send> Steps for Stepper<B> {
    fn description(&self) -> Description {
        self.board().description()
    }

    fn turn(&mut self, turn: &Turn) -> Result<Batch, BrokenPromise> {
        Self::turn(self, turn)
    }
}

/// Why a board cannot be built.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum KindError {
    /// There is no such kind.
    #[error("unknown kind of board '{kind}': expected one of {}", NAMES.join(", "))]
    Unknown {
        /// The kind that was asked for.
        kind: String,
    },
    /// Its settings are wrong.
    #[error("settings of this {kind}: {message}")]
    Settings {
        /// The kind of board.
        kind: String,
        /// What was expected, and what was found.
        message: String,
        /// Where in their text, if it is one place.
        span: Option<Range<usize>>,
    },
}

/// Builds a board as at power-on. `settings` is TOML.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn build(kind: &str, settings: &str, clock: Clock) -> Result<Box<dyn Steps>, KindError> {
    let table = DeTable::parse(settings).map_err(|error| wrong(kind, of_toml(error)))?;
    build_parsed(kind, &Spanned::new(table.span(), DeValue::Table(table.into_inner())), clock)
}

/// The same from settings that are part of a larger text: it is this text that an error's span lies in.
///
/// # Errors
/// As there.
pub fn build_parsed(kind: &str, settings: &Spanned<DeValue<'_>>, clock: Clock) -> Result<Box<dyn Steps>, KindError> {
    match kind {
        "master" => read(settings, MasterSettings::check).map(|s| boxed(Master::new(&s, clock))),
        "spindle" => read(settings, SpindleSettings::check).map(|s| boxed(Spindle::new(&s, clock))),
        "transverse" => read(settings, TransverseSettings::check).map(|s| boxed(Transverse::new(&s, clock))),
        "depth" => read(settings, DepthSettings::check).map(|s| boxed(Depth::new(&s, clock))),
        _ => return Err(KindError::Unknown { kind: kind.to_owned() }),
    }
    .map_err(|complaint| wrong(kind, complaint))
}

/// What telemetry tells of a motor's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// The counts of the window that ends at the sample.
    Window(&'static str),
    /// The count since the start.
    Position(&'static str),
}

/// What regulates a motor: its settings' names, with dots if they are in a table, and their values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// A lead compensator: its zero, its pole (negated) and its gain.
    Lead([(&'static str, f64); 3]),
    /// A PID: K1, K2 and K3.
    Pid([(&'static str, f64); 3]),
    /// It is switched on and off.
    OnOff,
}

/// A board's motor as seen from its bench: how to drive it, and what its encoder counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// What its encoder tells.
    pub encoder: Encoder,
    /// The time between samples, in ms of the board's clock.
    pub period_ms: u32,
    /// What one count is, in `unit`.
    pub count: f64,
    /// The unit of its position.
    pub unit: &'static str,
    /// Full drive in `input_unit`, and in the unit of telemetry's `drive`.
    pub full: (f64, i64),
    /// The unit of its drive.
    pub input_unit: &'static str,
    /// How far it can go either way, in counts; None if it turns for ever, and that one way only.
    pub travel: Option<u32>,
    /// What regulates it.
    pub law: Law,
}

/// The motor of a board of that kind with these settings (TOML); None if it has none.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn motor(kind: &str, settings: &str) -> Result<Option<Motor>, KindError> {
    let table = DeTable::parse(settings).map_err(|error| wrong(kind, of_toml(error)))?;
    let settings = Spanned::new(table.span(), DeValue::Table(table.into_inner()));
    match kind {
        "master" => Ok(None),
        "spindle" => read(&settings, SpindleSettings::check).map(|s| {
            Some(Motor {
                encoder: Encoder::Window("speed_counts"),
                period_ms: s.window_ms,
                // 50 pulses a revolution (§4).
                count: core::f64::consts::TAU / 50.0,
                unit: "rad",
                full: (s.supply_v, 1_023),
                input_unit: "V",
                travel: None,
                law: Law::Lead([("alpha", s.alpha), ("beta", s.beta), ("k", s.k)]),
            })
        }),
        "transverse" => read(&settings, TransverseSettings::check).map(|s| {
            Some(Motor {
                encoder: Encoder::Position("position_counts"),
                period_ms: s.sample_ms,
                count: 1.0,
                unit: "counts",
                full: (255.0, 255),
                input_unit: "LSB",
                travel: Some(s.travel_counts / 2),
                law: Law::Pid([("k1", s.k1), ("k2", s.k2), ("k3", s.k3)]),
            })
        }),
        "depth" => read(&settings, DepthSettings::check).map(|s| {
            Some(Motor {
                encoder: Encoder::Position("position_counts"),
                period_ms: s.poll_ms,
                count: s.length_mm / f64::from(s.slots),
                unit: "mm",
                full: (1.0, 1),
                input_unit: "on",
                travel: Some(s.slots / 2),
                law: Law::OnOff,
            })
        }),
        _ => return Err(KindError::Unknown { kind: kind.to_owned() }),
    }
    .map_err(|complaint| wrong(kind, complaint))
}

/// What is wrong with settings, and where.
type Complaint = (String, Option<Range<usize>>);

fn read<S: DeserializeOwned>(
    settings: &Spanned<DeValue<'_>>,
    check: impl Fn(&S) -> Result<(), String>,
) -> Result<S, Complaint> {
    let read = S::deserialize(ValueDeserializer::from(settings.clone())).map_err(of_toml)?;
    match check(&read) {
        Ok(()) => Ok(read),
        Err(message) => {
            // A check names the field first.
            let field = message.split(|c: char| c != '_' && !c.is_ascii_alphanumeric()).next();
            let span = field.and_then(|field| settings.get_ref().get(field)).map(Spanned::span);
            Err((message, span))
        }
    }
}

fn of_toml(error: toml::de::Error) -> Complaint {
    (error.message().to_owned(), error.span())
}

fn wrong(kind: &str, (message, span): Complaint) -> KindError {
    KindError::Settings { kind: kind.to_owned(), message, span }
}

fn boxed<B: Board + Send + 'static>(board: B) -> Box<dyn Steps> {
    Box::new(Stepper::new(board))
}
