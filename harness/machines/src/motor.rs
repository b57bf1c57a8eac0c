//! A board's motor as seen from its bench: how to drive it, what its encoder counts, what regulates it.

pub use torno_slaves::{FeedLaw, FeedSample, KEPT, Rehearsal, SpeedLaw, SpeedSample};

/// A board's motor on the bench, or in words why it has none that can be driven freely.
pub type OnBench = Result<Motor, &'static str>;

/// What a board lacks that has nothing to drive.
pub(crate) const NO_MOTOR: &str = "has no motor";

/// The telemetry of a motor's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// The counts of the window that ends at the sample.
    Window,
    /// The count since the start.
    Position,
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
    /// A sample comes so much later than its place on the grid, at most.
    pub jitter_us: u32,
    /// The dead time between its drive and it, in s.
    pub dead_s: f64,
    /// Its law is in one of the forms that show what is wrong in the paper.
    pub printed: Option<Form>,
}

/// A form of a law that is not the working one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// A lead compensator without its integrator: Eq. 7 at its word, or with feed-forward.
    Lead,
    /// Eq. 15 at its word.
    Pid,
    /// Fig. 9, with its gain Kch in units of drive per count.
    Proportional(f64),
    /// No loop.
    Open,
}
