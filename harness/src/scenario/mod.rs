//! Scenarios: a program, faults, and what must hold.
//!
//! A scenario is a list of steps. Each takes place at an exact virtual instant, so the same seed gives the same run
//! everywhere: a step that waits ends [`REACTION`](crate::engine::REACTION) after what it waited for; one that acts
//! takes no time.

mod batch;
mod conductor;
mod failure;
mod file;

pub use batch::{run_all, run_recorded};
pub use conductor::{Outcome, record, run};
pub use failure::Failure;
pub(crate) use file::RawCondition;
pub use file::ScenarioError;

use torno_protocol::time::{Instant, Span};

use crate::engine::NodeId;
use crate::fault::Fault;
use crate::rig::file::RigFile;

/// How long a step waits if nothing else is said.
pub const PATIENCE: Span = Span::from_secs(60);

/// A scenario, checked against its rig.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// What the rig is called: a built-in name or a file.
    pub rig: String,
    /// The rig.
    pub file: RigFile,
    /// Everything random comes from it.
    pub seed: u64,
    /// Whether `XOFF` and `XON` hold the PC.
    pub held: bool,
    /// What is done, in order.
    pub steps: Vec<Step>,
    /// Faults that begin by themselves.
    pub faults: Vec<(Trigger, Fault)>,
    /// What must hold at the end.
    pub finally: Vec<Claim>,
    /// What must hold throughout.
    pub always: Vec<Claim>,
    /// The whole conversation as the PC hears it, if it is prescribed.
    pub replies: Option<Vec<String>>,
    /// What must not happen.
    pub never: Vec<Condition>,
    /// The scenario ends here at the latest, even if the rig is not quiet.
    pub end: Span,
}

/// A step.
#[derive(Clone, Debug)]
pub struct Step {
    /// What it does, for people.
    pub does: String,
    /// What it does.
    pub action: Action,
}

/// What a step does.
#[derive(Clone, Debug)]
pub enum Action {
    /// The PC writes these bytes.
    Send(Vec<u8>),
    /// Time passes.
    Run(Span),
    /// Waits for something; it must come in time.
    Wait(Condition, Span),
    /// Something breaks.
    Break(Fault),
    /// The fault of this name ends.
    Heal(String),
    /// Something must hold now.
    Check(Claim),
}

/// When a fault begins.
#[derive(Clone, Debug)]
pub enum Trigger {
    /// At an instant.
    At(Instant),
    /// [`REACTION`](crate::engine::REACTION) after something happens.
    When(Condition),
}

/// Something that happens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The PC hears a reply.
    Reply(String),
    /// A quantity reaches a value within bounds.
    Value(Claim),
    /// A board tells of an event.
    Event {
        /// The board.
        node: NodeId,
        /// The event's number.
        event: u8,
        /// Its text, for people.
        text: String,
    },
    /// A board sends its `nth` character on a port, from 1.
    Character {
        /// The board.
        node: NodeId,
        /// Its port.
        port: u8,
        /// Which.
        nth: u64,
        /// The line, for people.
        line: String,
    },
}

/// A quantity lies within bounds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claim {
    /// The board.
    pub node: NodeId,
    /// The quantity's number.
    pub signal: u8,
    /// The least value.
    pub least: i64,
    /// The greatest.
    pub most: i64,
    /// `board.quantity`, for people.
    pub name: String,
}

impl Claim {
    /// Whether a value is within the bounds.
    pub fn holds(&self, value: i64) -> bool {
        (self.least..=self.most).contains(&value)
    }
}

impl std::fmt::Display for Claim {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.least, self.most) {
            (least, most) if least == most => write!(f, "{} = {least}", self.name),
            (i64::MIN, most) => write!(f, "{} ≤ {most}", self.name),
            (least, i64::MAX) => write!(f, "{} ≥ {least}", self.name),
            (least, most) => write!(f, "{} from {least} to {most}", self.name),
        }
    }
}

impl std::fmt::Display for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Reply(reply) => write!(f, "the reply {reply}"),
            Self::Value(claim) => write!(f, "{claim}"),
            Self::Event { text, .. } => write!(f, "the event '{text}'"),
            Self::Character { nth, line, .. } => write!(f, "character {nth} on {line}"),
        }
    }
}
