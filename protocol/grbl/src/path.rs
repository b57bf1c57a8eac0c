//! Straight motions, as blocks ask for them.

use crate::axes::Axes;

/// How fast a motion goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// As fast as the machine can.
    Rapid,
    /// mm a minute.
    Feed(f32),
    /// mm a minute, and no override changes it.
    Jog(f32),
    /// mm a turn of the spindle: G95.
    PerTurn(f32),
    /// The whole motion takes this part of a minute: G93.
    PerMinute(f32),
}

/// A straight motion to `to`, in machine coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Straight {
    /// Where it ends, mm.
    pub(crate) to: Axes,
    /// How fast.
    pub(crate) rate: Rate,
}
