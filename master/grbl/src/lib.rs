//! A GRBL controller as a board: the PC's G-code on one side, a machine on the other. The one that is here is the
//! lathe, whose master takes frames.

mod board;
mod lathe;
mod settings;
mod wired;

pub use board::{Board, Grbl};
pub use settings::{Eeprom, GrblSettings};
pub use wired::{EVENTS, PORTS, SIGNALS, Wired};
