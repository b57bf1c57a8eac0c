//! What moves, as the controller sees it.

use torno_protocol::time::Instant;

use crate::code::Alarm;
use crate::memory::Axes;
use crate::modal::Spindle;
use crate::path::Rate;

/// A straight motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Where it ends, in whole steps from the machine's zero.
    pub to: [i32; 3],
    /// The same as it was asked for, mm.
    pub place: Axes,
    /// How fast it goes.
    pub rate: Rate,
}

/// What the operator has changed, in percent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overrides {
    /// 10 to 200.
    pub feed: u8,
    /// 25, 50 or 100.
    pub rapid: u8,
    /// 10 to 200.
    pub spindle: u8,
}

impl Default for Overrides {
    fn default() -> Self {
        Self { feed: 100, rapid: 100, spindle: 100 }
    }
}

/// What has become of the motions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// All of them are done.
    Finished,
    /// It stands, as it was told to hold.
    Held,
    /// `$H` has found the ends.
    Homed,
    /// It cannot go on.
    Failed(Alarm),
}

/// What moves.
pub trait Machine {
    /// How many more motions it can take.
    fn room(&self) -> usize;

    /// Whether it has motions left.
    fn has_motions(&self) -> bool;

    /// Takes a motion, to be done after the others.
    fn push(&mut self, motion: Move);

    /// What the operator has to know of a motion that it cannot do as asked.
    fn remark(&self, _motion: &Move) -> Option<String> {
        None
    }

    /// Starts, or goes on.
    fn start(&mut self, now: Instant, overrides: Overrides);

    /// Stops as soon as it can, and says when it stands. Called only while it moves.
    fn hold(&mut self, now: Instant);

    /// Forgets its motions. One that it cannot stop goes on by itself.
    fn forget(&mut self, now: Instant);

    /// Looks for the ends of its axes.
    fn home(&mut self, now: Instant);

    /// The spindle from now on: its sense and its speed, rpm.
    fn spindle(&mut self, now: Instant, sense: Spindle, rpm: f32);

    /// The overrides have changed.
    fn override_by(&mut self, now: Instant, overrides: Overrides);

    /// Where it is, in steps.
    fn position(&self, now: Instant) -> [i32; 3];

    /// How fast it moves, mm a minute.
    fn rate(&self, now: Instant) -> f32;

    /// Which axes are at an end.
    fn ends(&self) -> [bool; 3];

    /// What has happened, one after the other.
    fn poll_progress(&mut self) -> Option<Progress>;
}
