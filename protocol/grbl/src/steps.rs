//! What a block does, step by step.

use crate::arc::Arc;
use crate::axes::Axes;
use crate::modal::{Probe, Spindle};
use crate::path::Straight;

/// A step of a block. Lines and arcs go into the planner; everything else waits until the machine has done what it was
/// given before.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Step {
    Line(Straight),
    Arc(Arc),
    Spindle {
        sense: Spindle,
        rpm: f32,
    },
    Flood(bool),
    Dwell {
        seconds: f32,
    },
    /// G43.1, G49, G54 to G59, G92, G92.1: the program's origin moves.
    Origin,
    /// G10: the origin of a coordinate system.
    System {
        system: usize,
        origin: Axes,
    },
    /// G28.1, G30.1.
    Home {
        home: usize,
        place: Axes,
    },
    Probe {
        probe: Probe,
        line: Straight,
    },
    Pause,
    End,
    /// `$Nx=`: the EEPROM is written.
    Write,
}

impl Step {
    /// Whether it waits until the machine has finished.
    pub(crate) const fn waits(&self) -> bool {
        !matches!(self, Self::Line(_) | Self::Arc(_))
    }
}
