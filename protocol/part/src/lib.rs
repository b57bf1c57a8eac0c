//! The part that a lathe turns: bar stock, a nose, the way that the tool went, and what is left.
//!
//! `z` is along the axis of the bar, in mm: 0 at its face, negative towards the chuck. `x` is the tool's distance from
//! that axis, in mm: a radius. Nothing here reads a file, a clock or a rig. All of it is ours: the lathe paper cuts
//! nothing.
//!
//! [`Nose`] is what cuts, [`Profile`] what is left of the bar, [`Turning`] goes the way and notes what should not
//! happen on it ([`Violation`]), [`cylinders`] measures the part, [`deviation`] holds it against another,
//! [`outline`] is what to draw of it. A [`Path`] is a way of lines and arcs, as a program asks for it.
//!
//! A bore is turned as the outside is, on the other [`Side`] of the wall.

mod cylinders;
mod deviation;
mod nose;
mod outline;
mod path;
mod profile;
mod turning;

pub use cylinders::{Cylinder, cylinders};
pub use deviation::{Deviation, SHOULDER, deviation, deviations, is_within};
pub use nose::Nose;
pub use outline::outline;
pub use path::{Arc, Move, Path, Place};
pub use profile::{GRID, Profile, Shaving, Side};
pub use turning::{Happening, Limits, Resolution, Turning, Violation};
