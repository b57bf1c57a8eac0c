//! The kinds of boards: the one place that knows what each is made of.

use serde::de::DeserializeOwned;
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
    },
}

/// Builds a board as at power-on. `settings` is TOML.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn build(kind: &str, settings: &str, clock: Clock) -> Result<Box<dyn Steps>, KindError> {
    let wrong = |message| KindError::Settings { kind: kind.to_owned(), message };
    match kind {
        "master" => read(settings, MasterSettings::check).map(|s| boxed(Master::new(&s, clock))),
        "spindle" => read(settings, SpindleSettings::check).map(|s| boxed(Spindle::new(&s, clock))),
        "transverse" => read(settings, TransverseSettings::check).map(|s| boxed(Transverse::new(&s, clock))),
        "depth" => read(settings, DepthSettings::check).map(|s| boxed(Depth::new(&s, clock))),
        _ => return Err(KindError::Unknown { kind: kind.to_owned() }),
    }
    .map_err(wrong)
}

fn read<S: DeserializeOwned>(text: &str, check: impl Fn(&S) -> Result<(), String>) -> Result<S, String> {
    let settings = toml::from_str(text).map_err(|error: toml::de::Error| error.message().to_owned())?;
    check(&settings).map(|()| settings)
}

fn boxed<B: Board + Send + 'static>(board: B) -> Box<dyn Steps> {
    Box::new(Stepper::new(board))
}
