//! What moves, as the controller sees it.

use torno_protocol::time::Instant;

use crate::axes::Axes;
use crate::code::Alarm;
use crate::memory::Settings;
use crate::modal::Spindle;
use crate::path::Rate;

/// A straight motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Where it ends, in whole steps from the machine's zero.
    pub to: Axes<i32>,
    /// The same as it was asked for: mm, of A degrees.
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
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Progress {
    /// All of them are done.
    Finished,
    /// It stands, as it was told to hold.
    Held,
    /// `$H` has found the ends.
    Homed,
    /// It cannot go on.
    Failed(Alarm),
    /// What the operator is to know: `[MSG:…]`. It must not hold `ok` or `error`: there are senders that take any
    /// line with these letters for the answer to theirs.
    Message(String),
}

/// What moves.
pub trait Machine {
    /// The settings from now on. Called before anything else, and whenever one is stored or restored.
    fn configure(&mut self, _settings: &Settings) {}

    /// How many more motions it can take.
    fn room(&self) -> usize;

    /// Whether it has motions left.
    fn has_motions(&self) -> bool;

    /// Takes a motion, to be done after the others, which may be under way. One that goes nowhere may be left out.
    fn push(&mut self, now: Instant, motion: Move);

    /// What the operator has to know of a motion that it cannot do as asked.
    fn remark(&self, _motion: &Move) -> Option<String> {
        None
    }

    /// Starts, or goes on.
    fn start(&mut self, now: Instant, overrides: Overrides);

    /// Stops as soon as it can, and says when it stands. Called only while it moves. The motions that are left stay,
    /// and so does the rest of the one that it has stopped.
    fn hold(&mut self, now: Instant);

    /// Forgets its motions and stops at once, or stands already. One that it cannot stop goes on by itself; it says
    /// when it is done.
    fn forget(&mut self, now: Instant);

    /// Looks for the ends of these axes: of all for `$H`, of one for `$HX`.
    fn home(&mut self, now: Instant, axes: Axes<bool>);

    /// The spindle from now on: its sense and its speed, rpm.
    fn spindle(&mut self, now: Instant, sense: Spindle, rpm: f32);

    /// The overrides have changed.
    fn override_by(&mut self, now: Instant, overrides: Overrides);

    /// Where it is, in steps.
    fn position(&self, now: Instant) -> Axes<i32>;

    /// How fast it moves, mm a minute.
    fn rate(&self, now: Instant) -> f32;

    /// Which axes are at an end.
    fn ends(&self) -> Axes<bool>;

    /// What has happened, one after the other.
    fn poll_progress(&mut self) -> Option<Progress>;
}
