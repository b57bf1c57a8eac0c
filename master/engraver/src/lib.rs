//! The engraver's board: one controller that speaks GRBL and moves up to four closed-loop stepper axes, which are
//! joined to it by pins. Nothing here does I/O or reads a clock.
//!
//! After "Research on Low-Cost Implementation of Closed-loop Control Program for a Small Engraving Machine" (Lu and
//! others, 2016), called the paper here: an STM32F217, four axes whose carriages turn encoders by belts. The paper does
//! not say how its board is spoken to; the GRBL conversation is ours.
//!
//! - `settings`: what the rig file says of the board
//! - `machine`: the controller's machine: planned segments in, trains of pulses out
//! - `motions`: how motions become trains: interpolated, or as the paper has them
//! - `joint`: one axis with its pins and its loop
//! - `probe`: what the lines of its encoder do, for whoever looks
//! - `homing`: how the ends of travel are found

mod board;
mod homing;
mod joint;
mod machine;
mod motions;
mod probe;
mod settings;

pub use board::{Engraver, engraver};
pub use settings::{EngraverSettings, Motion, Others, Preset, TravelSettings};
