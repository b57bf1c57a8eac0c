//! What a board tells in counts and steps of its own, in units for people: mm, degrees, V, %.

use serde::Serialize;
use torno_machines::kinds;

use crate::rig::file::{Board, RigFile};

/// The units that a board tells, the one that a million of them are, and a thousandth of that.
pub const UNITS: [(&str, &str, &str); 2] = [("nm", "mm", "um"), ("udeg", "deg", "mdeg")];
/// So many of the first are one of the second.
pub const MILLION: f64 = 1e6;

/// A unit for people.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Physical {
    /// The unit.
    pub unit: &'static str,
    /// What one of what the board tells is in it.
    pub worth: f64,
    /// So many digits after the point are told.
    pub digits: usize,
    /// What the board tells are counts, which people want to see, too.
    pub is_counted: bool,
}

impl Physical {
    /// The unit for positions of a board's motor that are told in `unit`. None, if that is one for people already, or
    /// nobody knows what a count is worth.
    pub fn of_position(board: &Board, motor: u8, unit: &str) -> Option<Self> {
        if let Some((_, unit, _)) = UNITS.iter().find(|(told, ..)| unit == *told) {
            return Some(Self { unit, worth: 1.0 / MILLION, digits: 3, is_counted: false });
        }
        let carriage = kinds::carriage(&board.kind, &board.settings, motor).ok()?.filter(|_| unit == "counts")?;
        Some(Self { unit: "mm", worth: carriage.mm_per_count, digits: 3, is_counted: true })
    }

    /// The unit for the speed of an axis that is told in counts for so many ms.
    pub fn of_speed(board: &Board, motor: u8, unit: &str) -> Option<Self> {
        let ms: f64 = unit.strip_prefix("counts/")?.strip_suffix(" ms")?.parse().ok()?;
        let position = Self::of_position(board, motor, "counts")?;
        Some(Self { unit: "mm/s", worth: position.worth / ms * 1e3, digits: 2, is_counted: true })
    }

    /// The unit for the drive of a board's motor: V, or a share of the fullest. None, if nobody knows that.
    pub fn of_drive(board: &Board, motor: u8) -> Option<Self> {
        let (full, volts) = kinds::full_drive(&board.kind, &board.settings, motor).ok()??;
        let full = full as f64;
        Some(match volts {
            Some(volts) => Self { unit: "V", worth: volts / full, digits: 2, is_counted: false },
            None => Self { unit: "%", worth: 100.0 / full, digits: 0, is_counted: false },
        })
    }

    /// A value in this unit, with it.
    pub fn text(&self, value: f64) -> String {
        let Self { unit, worth, digits, .. } = self;
        format!("{:.digits$} {unit}", value * worth)
    }
}

/// The board of a rig at this place; None of a PC's gateway, or if nobody knows the rig.
pub fn board(file: Option<&RigFile>, node: usize) -> Option<&Board> {
    file?.boards.get(node)
}
