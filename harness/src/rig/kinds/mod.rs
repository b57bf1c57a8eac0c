//! The kinds of boards: the one place that knows what each is made of.

pub mod axis;
pub mod motor;

use std::ops::Range;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Table};
use torno_dspic::{Dspic, DspicSettings};
use torno_master::{Master, MasterSettings};
use torno_protocol::board::{Board, Description};
use torno_protocol::clock::Clock;
use torno_protocol::record::{Batch, Turn};
use torno_protocol::stepping::{BrokenPromise, Stepper};
use torno_slaves::{
    Depth, DepthSettings, Servo, ServoSettings, Spindle, SpindleSettings, Transverse, TransverseSettings,
};

use torno_text::{Complaint, of_toml};

/// The kinds of boards that there are.
pub const NAMES: [&str; 6] = ["master", "spindle", "transverse", "depth", "dspic", "servo"];

/// A board of any kind with its stepper.
pub trait Steps: Send {
    /// What the board consists of.
    fn description(&self) -> Description;

    /// Takes a turn.
    ///
    /// # Errors
    /// See [`Stepper::turn`].
    fn turn(&mut self, turn: Turn) -> Result<Batch, BrokenPromise>;
}

impl<B: Board + Send> Steps for Stepper<B> {
    fn description(&self) -> Description {
        self.board().description()
    }

    fn turn(&mut self, turn: Turn) -> Result<Batch, BrokenPromise> {
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
        /// Where in their text.
        span: Range<usize>,
    },
}

/// Builds a board as at power-on. `settings` is TOML.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn build(kind: &str, settings: &str, clock: Clock) -> Result<Box<dyn Steps>, KindError> {
    let table = DeTable::parse(settings).map_err(|error| wrong(kind, of_toml(&error)))?;
    build_parsed(kind, &Spanned::new(table.span(), DeValue::Table(table.into_inner())), clock)
}

/// The same from settings that are part of a larger text: it is this text that an error's span lies in.
///
/// # Errors
/// As there.
pub fn build_parsed(kind: &str, settings: &Spanned<DeValue<'_>>, clock: Clock) -> Result<Box<dyn Steps>, KindError> {
    Ok(match parsed(kind, settings)? {
        Settings::Master(s) => boxed(Master::new(&s, clock)),
        Settings::Spindle(s) => boxed(Spindle::new(&s, clock)),
        Settings::Transverse(s) => boxed(Transverse::new(&s, clock)),
        Settings::Depth(s) => boxed(Depth::new(&s, clock)),
        Settings::Dspic(s) => boxed(Dspic::new(&s, clock)),
        Settings::Servo(s) => boxed(Servo::new(&s, clock)),
    })
}

/// The settings of a board of that kind. `settings` is TOML.
///
/// # Errors
/// [`KindError`] if there is no such kind, or they are wrong.
pub(super) fn settings_of(kind: &str, settings: &str) -> Result<Settings, KindError> {
    let table = DeTable::parse(settings).map_err(|error| wrong(kind, of_toml(&error)))?;
    parsed(kind, &Spanned::new(table.span(), DeValue::Table(table.into_inner())))
}

/// The settings of a board of each kind.
pub(super) enum Settings {
    Master(MasterSettings),
    Spindle(SpindleSettings),
    Transverse(TransverseSettings),
    Depth(DepthSettings),
    Dspic(Box<DspicSettings>),
    Servo(ServoSettings),
}

fn parsed(kind: &str, settings: &Spanned<DeValue<'_>>) -> Result<Settings, KindError> {
    match kind {
        "master" => read(settings, MasterSettings::check).map(Settings::Master),
        "spindle" => read(settings, SpindleSettings::check).map(Settings::Spindle),
        "transverse" => read(settings, TransverseSettings::check).map(Settings::Transverse),
        "depth" => read(settings, DepthSettings::check).map(Settings::Depth),
        "dspic" => read(settings, DspicSettings::check).map(|s| Settings::Dspic(Box::new(s))),
        "servo" => read(settings, ServoSettings::check).map(Settings::Servo),
        _ => return Err(KindError::Unknown { kind: kind.to_owned() }),
    }
    .map_err(|complaint| wrong(kind, complaint))
}

fn read<S: DeserializeOwned + Default + Serialize>(
    settings: &Spanned<DeValue<'_>>,
    check: impl Fn(&S) -> Result<(), String>,
) -> Result<S, Complaint> {
    let read = S::deserialize(ValueDeserializer::from(settings.clone())).map_err(|error| {
        let (span, message) = of_toml(&error);
        (span, elsewhere::<S>(&message).unwrap_or(message))
    })?;
    match check(&read) {
        Ok(()) => Ok(read),
        Err(message) => {
            // A check names the field first.
            let field = message.split(':').next().unwrap_or_default();
            let place = field.split('.').try_fold(settings, |table, word| table.get_ref().get(word));
            let span = place.map_or(settings.span(), Spanned::span);
            Err((span, message))
        }
    }
}

/// A complaint about a field that is unknown where it stands and known in another table, with the other place.
fn elsewhere<S: Default + Serialize>(message: &str) -> Option<String> {
    let name = message.strip_prefix("unknown field `")?.split('`').next()?;
    let table = Table::try_from(S::default()).ok()?;
    let place = place_of(&table, name)?;
    Some(format!("unknown field `{name}`: did you mean '{place}'?"))
}

fn place_of(table: &Table, name: &str) -> Option<String> {
    table.iter().find_map(|(table, value)| {
        let inner = value.as_table()?;
        let deeper = if inner.contains_key(name) { Some(name.to_owned()) } else { place_of(inner, name) };
        deeper.map(|deeper| format!("{table}.{deeper}"))
    })
}

fn wrong(kind: &str, (span, message): Complaint) -> KindError {
    KindError::Settings { kind: kind.to_owned(), message, span }
}

fn boxed<B: Board + Send + 'static>(board: B) -> Box<dyn Steps> {
    Box::new(Stepper::new(board))
}
