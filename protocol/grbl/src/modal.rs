//! What stays in force from one block to the next.

use crate::axes::{Axes, Z};
use crate::memory::SYSTEMS;

/// The group of motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Motion {
    /// G0.
    #[default]
    Rapid,
    /// G1.
    Linear,
    /// G2, G3.
    Arc { clockwise: bool },
    /// G38.2 to G38.5.
    Probe(Probe),
    /// G80.
    None,
}

/// Which probing cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Probe {
    /// G38.4, G38.5: until the contact opens.
    pub(crate) away: bool,
    /// G38.3, G38.5: no alarm if nothing is met.
    pub(crate) no_error: bool,
}

/// The sense of the spindle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spindle {
    /// M5.
    #[default]
    Off,
    /// M3.
    Clockwise,
    /// M4.
    Counterclockwise,
}

/// What the feed is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum FeedMode {
    /// G94: mm a minute.
    #[default]
    PerMinute,
    /// G93.
    InverseTime,
    /// G95: mm a turn of the spindle.
    PerTurn,
}

/// What stays in force from one block to the next; a reset forgets it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Modal {
    pub(crate) motion: Motion,
    /// 0 for G54.
    pub(crate) system: usize,
    /// 0 for G17, 1 for G18, 2 for G19.
    pub(crate) plane: usize,
    /// G20.
    pub(crate) inches: bool,
    /// G91.
    pub(crate) incremental: bool,
    pub(crate) feed_mode: FeedMode,
    /// G7: X words are diameters.
    pub(crate) diameter: bool,
    /// G96: S is the speed at the tool, m a minute.
    pub(crate) surface: bool,
    /// G96: the spindle does not exceed it, rpm; 0 for its own limit.
    pub(crate) most_rpm: f32,
    pub(crate) spindle: Spindle,
    /// M8.
    pub(crate) flood: bool,
    pub(crate) tool: u8,
    /// As it was programmed last.
    pub(crate) feed: f32,
    /// As it was programmed last.
    pub(crate) speed: f32,
    /// What comes of it for the spindle.
    pub(crate) rpm: f32,
    /// G92: mm.
    pub(crate) shift: Axes,
    /// G43.1: mm, along Z.
    pub(crate) tool_length: f32,
    /// Where the last block ends, in machine coordinates.
    pub(crate) position: Axes,
}

impl Modal {
    /// The axes of the plane, in the order that makes a counterclockwise turn positive.
    pub(crate) const fn plane_axes(&self) -> [usize; 2] {
        match self.plane {
            0 => [0, 1],
            1 => [2, 0],
            _ => [1, 2],
        }
    }

    /// The program's origin in machine coordinates.
    pub(crate) fn origin(&self, systems: &[Axes; SYSTEMS]) -> Axes {
        let system = systems[self.system.min(SYSTEMS - 1)];
        let mut origin = core::array::from_fn(|axis| system[axis] + self.shift[axis]);
        origin[Z] += self.tool_length;
        origin
    }

    /// What only a lathe has is no longer in force.
    pub(crate) fn leave_lathe_mode(&mut self) {
        if self.feed_mode == FeedMode::PerTurn {
            (self.feed_mode, self.feed) = (FeedMode::PerMinute, 0.0);
        }
        if self.surface {
            (self.surface, self.speed) = (false, self.rpm);
        }
        self.diameter = false;
    }
}
