//! Scenarios: a program, faults, and what must hold.
//!
//! A scenario is a list of steps. Each takes place at an exact virtual instant, so the same seed gives the same run
//! everywhere: a step that waits ends [`REACTION`](torno_engine::REACTION) after what it waited for; one that acts
//! takes no time.

mod batch;
mod conductor;
mod failure;
mod file;
mod junit;
mod part;
pub mod prose;
mod tested;

pub use batch::{in_order, run_one, show_one};
pub use conductor::{Keep, Outcome, Verdict, record, run, run_in_slices, show};
pub use failure::Failure;
pub use file::ScenarioError;
pub use part::{AsAsked, Diameter, PartExpected};
pub use tested::{Attempt, Broken, TestReport, Tested, seed_text, shell_word};

use torno_protocol::time::Span;

use crate::condition::{Claim, Condition};
use crate::fault::{Fault, Planned};
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
    /// What has been drawn by lot from it, and for which place of the file.
    pub drawn: Vec<(String, String)>,
    /// Whether `XOFF` and `XON` hold the PC.
    pub held: bool,
    /// What is done, in order.
    pub steps: Vec<Step>,
    /// Faults that begin by themselves.
    pub faults: Vec<Planned>,
    /// What must hold at the end.
    pub finally: Vec<Claim>,
    /// What must hold throughout.
    pub always: Vec<Claim>,
    /// The whole conversation as the PC hears it, if it is prescribed.
    pub replies: Option<Vec<String>>,
    /// What must not happen.
    pub never: Vec<Condition>,
    /// What is expected of the part, if something is.
    pub part: Option<PartExpected>,
    /// The scenario ends here at the latest, even if the rig is not quiet.
    pub end: Span,
}

impl Scenario {
    /// Whether anything in it comes from the seed.
    pub fn is_random(&self) -> bool {
        let broken = self.steps.iter().filter_map(|step| match &step.action {
            Action::Break(fault) => Some(fault),
            _ => None,
        });
        let mut faults = self.faults.iter().map(|planned| &planned.fault).chain(broken);
        !self.drawn.is_empty() || faults.any(Fault::is_random)
    }
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
    /// The part must be as it was asked for, as far as it has been turned now.
    CheckPart(AsAsked),
}
