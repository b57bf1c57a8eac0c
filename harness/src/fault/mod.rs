//! Faults: what can break in a rig, where, when and for how long.
//!
//! A [`Fault`] is what breaks; [`Broken`] is one that has begun and can be healed. When it begins is for others to say:
//! a scenario, a person.

mod file;
mod quantity;

pub use file::{Names, RawFault};
pub use quantity::{Ratio, parse_ratio, parse_span};

use torno_protocol::board::Stimulus;
use torno_protocol::clock::Clock;
use torno_protocol::time::{Instant, Span};

use crate::engine::{Disturbance, FaultId, LineId, NodeId};
use crate::rig::Rig;

/// A brown-out lasts so long if nothing else is said. (Ours: long enough for a reset, too short for a person.)
pub const BROWN_OUT: Span = Span::from_millis(20);
/// The steps of a drifting oscillator.
const DRIFT_STEP: Span = Span::from_millis(100);
/// An oscillator that drifts does so for this long at the most.
const DRIFT_MAX: Span = Span::from_secs(600);

/// What breaks, and for how long.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// What it is called, to be healed by.
    pub name: String,
    /// What breaks.
    pub what: What,
    /// How long it lasts; until it is healed, if nothing is said.
    pub lasts: Option<Span>,
}

/// What breaks.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// A line.
    Line(LineId, Disturbance),
    /// A board: its firmware, its supply, its oscillator, its motor.
    Board(NodeId, Ailment),
}

/// What can happen to a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ailment {
    /// The firmware runs no more; only a loss of supply brings it back, and that is what healing is.
    Crash,
    /// The firmware stands still, and runs on when it is healed.
    Hang,
    /// The firmware starts anew.
    Reset,
    /// The supply is gone.
    PowerOff,
    /// The firmware takes so long over everything.
    Slow(Span),
    /// The oscillator is off by so much, instead of by what the rig file says.
    Clock(Clock),
    /// The oscillator drifts by so many parts per billion a second.
    Drift(i32),
    /// The encoder loses (negative) or invents counts.
    Counts(i32),
    /// The motor's shaft is blocked.
    Stall,
    /// A load on the motor, in per mille of its torque at standstill.
    Load(i32),
    /// The motor's supply, in per mille.
    Supply(u16),
    /// Dead travel between motor and carriage, in counts.
    Backlash(u16),
    /// Something hard in the carriage's way, so many counts from mid-travel.
    EndStop(i32),
}

/// A fault that has begun.
#[derive(Clone, Debug)]
pub struct Broken {
    /// When.
    pub since: Instant,
    /// The fault on the line, if it is one.
    pub line: Option<FaultId>,
    cure: Vec<(NodeId, Stimulus)>,
}

impl Fault {
    /// Whether it waits for something to come along that it can spoil.
    pub fn lies_in_wait(&self) -> bool {
        matches!(self.what, What::Line(_, Disturbance::Character { .. }))
    }

    /// Begins at `at`, or as soon after it as nothing settled is touched; ends by itself if it lasts for a time.
    pub fn begin(&self, rig: &mut Rig, at: Instant) -> Broken {
        match &self.what {
            What::Line(line, disturbance) => {
                let (fault, since) = rig.disturb(*line, at, disturbance);
                if let Some(lasts) = self.lasts {
                    rig.heal(fault, since + lasts);
                }
                Broken { since, line: Some(fault), cure: Vec::new() }
            }
            What::Board(node, ailment) => {
                let usual = rig.nodes()[*node].clock;
                let (begin, cure) = ailment.stimuli(usual, self.lasts);
                let mut since = at;
                for (n, (after, stimulus)) in begin.into_iter().enumerate() {
                    let done = rig.stimulate(*node, since + after, stimulus);
                    since = if n == 0 { done } else { since };
                }
                let broken = Broken { since, line: None, cure: cure.into_iter().map(|cure| (*node, cure)).collect() };
                if let Some(lasts) = self.lasts {
                    broken.clone().heal(rig, since + lasts);
                    return Broken { cure: Vec::new(), ..broken };
                }
                broken
            }
        }
    }
}

impl Broken {
    /// Ends at `at`, or as soon after it as nothing settled is touched. Says when.
    pub fn heal(self, rig: &mut Rig, at: Instant) -> Instant {
        let at = match self.line {
            Some(fault) => rig.heal(fault, at),
            None => at,
        };
        self.cure.into_iter().fold(at, |at, (node, stimulus)| rig.stimulate(node, at, stimulus))
    }
}

impl Ailment {
    /// What a board is told when it begins (so long after it), and when it is healed.
    fn stimuli(self, usual: Clock, lasts: Option<Span>) -> (Vec<(Span, Stimulus)>, Vec<Stimulus>) {
        let one = |stimulus| vec![(Span::ZERO, stimulus)];
        match self {
            Self::Crash => (one(Stimulus::Hang(true)), vec![Stimulus::Power(false), Stimulus::Power(true)]),
            Self::Hang => (one(Stimulus::Hang(true)), vec![Stimulus::Hang(false)]),
            Self::Reset => (one(Stimulus::Reset), vec![]),
            Self::PowerOff => (one(Stimulus::Power(false)), vec![Stimulus::Power(true)]),
            Self::Slow(by) => (one(Stimulus::Slow(by)), vec![Stimulus::Slow(Span::ZERO)]),
            Self::Clock(clock) => (one(Stimulus::Clock(clock)), vec![Stimulus::Clock(usual)]),
            Self::Drift(per_second) => {
                let steps = 1..=(lasts.unwrap_or(DRIFT_MAX).as_nanos() / DRIFT_STEP.as_nanos());
                let clock = |step: u64| {
                    let drift = i64::from(per_second) * i64::try_from(step).unwrap_or(i64::MAX) / 10;
                    let error = i32::try_from(i64::from(usual.error_ppb()) + drift).ok();
                    error.and_then(Clock::from_ppb)
                };
                let stimuli = steps
                    .map_while(|step| clock(step).map(|clock| (DRIFT_STEP.times(step - 1), Stimulus::Clock(clock))));
                (stimuli.collect(), vec![Stimulus::Clock(usual)])
            }
            Self::Counts(counts) => (one(Stimulus::Counts(counts)), vec![]),
            Self::Stall => (one(Stimulus::Stall(true)), vec![Stimulus::Stall(false)]),
            Self::Load(load) => (one(Stimulus::Load(load)), vec![Stimulus::Load(0)]),
            Self::Supply(supply) => (one(Stimulus::Supply(supply)), vec![Stimulus::Supply(1000)]),
            Self::Backlash(counts) => (one(Stimulus::Backlash(counts)), vec![Stimulus::Backlash(0)]),
            Self::EndStop(counts) => (one(Stimulus::EndStop(counts)), vec![Stimulus::EndStop(0)]),
        }
    }
}
