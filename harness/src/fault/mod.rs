//! Faults: what can break in a rig, where, when and for how long.
//!
//! A [`Fault`] is what breaks; a [`Trigger`] says when it begins. [`Faults`] are all those of a running rig: planned,
//! begun, healed. A scenario, a file or a person says which.

mod faults;
mod file;

pub use faults::{Cause, Faults, HealError, Planned, Trigger, Unfired};
pub(crate) use file::text_drawn;
pub use file::{BOARD_KINDS, FaultFile, FaultFileError, FaultKind, LINE_KINDS, RawFault, fault_kinds, load, parse};

use torno_protocol::board::{Capability, Channel, MotorStimulus, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::time::{Instant, Span};

use crate::rig::Rig;
use torno_engine::{Disturbance, FaultId, LineId, NodeId};

/// A brown-out lasts so long if nothing else is said. (Ours: long enough for a reset, too short for a person.)
pub const BROWN_OUT: Span = Span::from_millis(20);
/// The period of noise that takes no share of the time.
const NEVER_A_PULSE: Span = Span::from_nanos(u64::MAX);
/// The steps of a drifting oscillator.
const DRIFT_STEP: Span = Span::from_millis(100);

/// What breaks, and for how long.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// What it is called, to be healed by.
    pub name: String,
    /// What breaks.
    pub what: Site,
    /// How long it lasts; until it is healed, if nothing is said.
    pub lasts: Option<Span>,
}

/// What breaks.
#[derive(Clone, Debug, PartialEq)]
pub enum Site {
    /// A line.
    Line(LineId, Disturbance),
    /// A board: its firmware, its supply, its oscillator, its motor. If it has several: which.
    Board(NodeId, Option<u8>, BoardFault),
}

/// What can happen to a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BoardFault {
    /// The firmware runs no more; only a loss of supply brings it back, and that is what healing is.
    Crash,
    /// The firmware stands still, and runs on when it is healed.
    Hang,
    /// The firmware restarts.
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
    /// A force pushes a stepper's carriage, in per mille of the holding torque.
    Push(i32),
    /// A stepper's rotor slips by so many electrical turns.
    Slip(i32),
    /// A stepper's drive loses one pulse in so many.
    Skip(u32),
    /// A hit bends a stepper's mechanism for good, by so many micrometres.
    Shift(i32),
    /// The channels of a stepper's encoder are exchanged.
    Swap,
    /// A channel of a stepper's encoder is dead.
    Dead(Channel),
}

/// A fault that has begun.
#[derive(Clone, Debug)]
struct Broken {
    /// When.
    since: Instant,
    /// The fault on the line, if it is one.
    line: Option<FaultId>,
    /// When it ends by itself.
    until: Instant,
    /// What a board is told when it ends. A stimulus cannot be taken back, so that is told when the time has come.
    cure: Vec<(NodeId, Stimulus)>,
    drift: Option<Drift>,
}

/// An oscillator on its way; each step is given when its time has come.
#[derive(Clone, Debug)]
struct Drift {
    node: NodeId,
    usual: Clock,
    per_second: i32,
    /// How many steps have been taken.
    taken: i64,
    next: Instant,
    until: Instant,
}

impl Drift {
    /// Takes the next step. Says whether there will be another one: no oscillator is off by more than a [`Clock`] can.
    fn step(&mut self, rig: &mut Rig) -> bool {
        self.taken += 1;
        let drift = i64::from(self.per_second) * self.taken / 10;
        let error = i32::try_from(i64::from(self.usual.error_ppb()) + drift).ok();
        let Some(clock) = error.and_then(Clock::from_ppb) else { return false };
        rig.stimulate(self.node, self.next, Stimulus::Clock(clock));
        self.next += DRIFT_STEP;
        self.next < self.until
    }
}

impl Site {
    /// Whether it happens in an instant: then there is nothing to heal.
    pub const fn is_over_at_once(&self) -> bool {
        matches!(
            self,
            Self::Board(_, _, BoardFault::Reset | BoardFault::Counts(_) | BoardFault::Slip(_) | BoardFault::Shift(_))
        )
    }
}

impl Fault {
    /// The character that it waits for, to spoil it: on which line, and which.
    const fn awaited(&self) -> Option<(LineId, u64)> {
        match &self.what {
            Site::Line(line, Disturbance::Character { nth, .. }) => Some((*line, *nth)),
            _ => None,
        }
    }

    /// Whether it happens in an instant: then there is nothing to heal.
    pub const fn is_over_at_once(&self) -> bool {
        self.what.is_over_at_once()
    }

    /// Whether it is not the same with every seed.
    pub const fn is_random(&self) -> bool {
        matches!(self.what, Site::Line(_, Disturbance::Noise { .. }))
    }

    fn until(&self, since: Instant) -> Instant {
        if self.is_over_at_once() { since } else { self.lasts.map_or(Instant::NEVER, |lasts| since + lasts) }
    }

    /// Begins at `at`, or as soon after it as nothing settled is touched.
    fn begin(&self, rig: &mut Rig, at: Instant) -> Broken {
        match &self.what {
            Site::Line(_, Disturbance::Noise { period, .. }) if *period == NEVER_A_PULSE => {
                Broken { since: at, line: None, until: self.until(at), cure: Vec::new(), drift: None }
            }
            Site::Line(line, disturbance) => {
                let (fault, since) = rig.disturb(*line, at, disturbance);
                let until = self.until(since);
                if !until.is_never() {
                    rig.heal(fault, until);
                }
                Broken { since, line: Some(fault), until, cure: Vec::new(), drift: None }
            }
            Site::Board(node, motor, fault) => {
                let usual = rig.nodes()[*node].clock;
                // A board that is named without a motor has one at the most.
                let (begin, cure) = fault.stimuli(usual, motor.unwrap_or(0));
                let since = begin.map_or(at, |stimulus| rig.stimulate(*node, at, stimulus));
                let until = self.until(since);
                let drift = match fault {
                    // One that goes nowhere would have no end of steps.
                    BoardFault::Drift(0) => None,
                    BoardFault::Drift(per_second) => {
                        Some(Drift { node: *node, usual, per_second: *per_second, taken: 0, next: since, until })
                    }
                    _ => None,
                };
                let cure = cure.into_iter().map(|cure| (*node, cure)).collect();
                Broken { since, line: None, until, cure, drift }
            }
        }
    }
}

impl Broken {
    /// When it ends by itself, if a board has to be told so.
    fn ends(&self) -> Option<Instant> {
        (!self.until.is_never() && !self.cure.is_empty()).then_some(self.until)
    }

    /// When [`Broken::go_on`] is due, if the fault gets worse with time or ends by itself.
    fn next(&self) -> Option<Instant> {
        self.drift.as_ref().map(|drift| drift.next).into_iter().chain(self.ends()).min()
    }

    /// Gets worse or ends at [`Broken::next`], once everything before that has happened.
    fn go_on(&mut self, rig: &mut Rig) {
        match self.drift.take() {
            Some(mut drift) if drift.next < self.until => self.drift = drift.step(rig).then_some(drift),
            _ => {
                let cure = core::mem::take(&mut self.cure);
                for (node, stimulus) in cure {
                    rig.stimulate(node, self.until, stimulus);
                }
            }
        }
    }

    /// Ends at `at`, or as soon after it as nothing settled is touched. Says when.
    fn heal(self, rig: &mut Rig, at: Instant) -> Instant {
        let at = match self.line {
            Some(fault) => rig.heal(fault, at),
            None => at,
        };
        self.cure.into_iter().fold(at, |at, (node, stimulus)| rig.stimulate(node, at, stimulus))
    }
}

impl BoardFault {
    /// What a board or its motor must be capable of for this to mean anything to it.
    const fn needs(self) -> Option<Capability> {
        match self {
            Self::Reset => Some(Capability::Reset),
            Self::Counts(_) | Self::Stall | Self::Load(_) | Self::Supply(_) => Some(Capability::Motor),
            Self::Backlash(_) | Self::EndStop(_) => Some(Capability::Axis),
            Self::Push(_) | Self::Slip(_) | Self::Skip(_) | Self::Shift(_) | Self::Swap | Self::Dead(_) => {
                Some(Capability::Stepper)
            }
            Self::Crash | Self::Hang | Self::PowerOff | Self::Slow(_) | Self::Clock(_) | Self::Drift(_) => None,
        }
    }

    /// What a board is told when it begins, and when it is healed.
    fn stimuli(self, usual: Clock, motor: u8) -> (Option<Stimulus>, Vec<Stimulus>) {
        let (begin, cure) = match self {
            Self::Crash => (Stimulus::Hang(true), vec![Stimulus::Power(false), Stimulus::Power(true)]),
            Self::Hang => (Stimulus::Hang(true), vec![Stimulus::Hang(false)]),
            Self::Reset => (Stimulus::Reset, vec![]),
            Self::PowerOff => (Stimulus::Power(false), vec![Stimulus::Power(true)]),
            Self::Slow(by) => (Stimulus::Slow(by), vec![Stimulus::Slow(Span::ZERO)]),
            Self::Clock(clock) => (Stimulus::Clock(clock), vec![Stimulus::Clock(usual)]),
            Self::Drift(_) => return (None, vec![Stimulus::Clock(usual)]),
            Self::Counts(counts) => (MotorStimulus::Counts(counts).of(motor), vec![]),
            Self::Stall => (MotorStimulus::Stall(true).of(motor), vec![MotorStimulus::Stall(false).of(motor)]),
            Self::Load(load) => (MotorStimulus::Load(load).of(motor), vec![MotorStimulus::Load(0).of(motor)]),
            Self::Supply(supply) => {
                (MotorStimulus::Supply(supply).of(motor), vec![MotorStimulus::Supply(1000).of(motor)])
            }
            Self::Backlash(counts) => {
                (MotorStimulus::Backlash(counts).of(motor), vec![MotorStimulus::Backlash(0).of(motor)])
            }
            Self::EndStop(counts) => {
                (MotorStimulus::EndStop(counts).of(motor), vec![MotorStimulus::EndStop(0).of(motor)])
            }
            Self::Push(push) => (MotorStimulus::Push(push).of(motor), vec![MotorStimulus::Push(0).of(motor)]),
            Self::Slip(turns) => (MotorStimulus::Slip(turns).of(motor), vec![]),
            Self::Skip(every) => (MotorStimulus::Skip(every).of(motor), vec![MotorStimulus::Skip(0).of(motor)]),
            Self::Shift(um) => (MotorStimulus::Shift(um).of(motor), vec![]),
            Self::Swap => (MotorStimulus::Swap(true).of(motor), vec![MotorStimulus::Swap(false).of(motor)]),
            Self::Dead(channel) => {
                (MotorStimulus::Dead(Some(channel)).of(motor), vec![MotorStimulus::Dead(None).of(motor)])
            }
        };
        (Some(begin), cure)
    }
}
