//! The interpolated motion of a GRBL-like controller: straight motions in, trains of step pulses out.
//!
//! A [`Planner`] holds the motions as blocks. It looks ahead over them, so that each block ends as fast as the next
//! junction allows. It gives one [`Segment`] after the other: in a segment all axes move evenly, and each axis has one
//! [`Train`] of pulses. There is no deadline for a pulse: the only deadlines are the ends of segments.
//!
//! The behaviour is that of GRBL 1.1h, and its positions are held against the firmware's. What it does is described in
//! the GRBL wiki ("Configuring Grbl v1.1", `$11`, `$110` to `$122`) and in "Improving Grbl: Cornering Algorithm"
//! (onehossshay.wordpress.com, 2011), where the junction deviation comes from. The code is our own.
//!
//! A board works like this:
//!
//! 1. It pushes motions while there is [room](Planner::room), and [starts](Planner::start) the cycle.
//! 2. It gives its axes the [`segment`](Planner::segment) that is under way. The segment's end is its next deadline.
//! 3. At that instant it calls [`advance`](Planner::advance), and takes the next segment.
//! 4. If there is none, the axes stand: at the end of all motions, or after a hold.
//!
//! A [`Sequencer`] is the other way to move, which the engraver's paper describes: it has no ramps and does not keep
//! to lines.
//!
//! Lengths are mm, speeds in settings mm a minute, accelerations mm/s². An axis that turns has degrees in place of mm,
//! as in GRBL. Nothing is drawn at random, and no transcendental function is used: the pulses are the same on every
//! machine, and they do not depend on how often anybody asks.

mod block;
mod junction;
mod limits;
mod look_ahead;
mod planner;
mod profile;
mod segment;
mod sequencer;
mod timer;

pub use block::Rate;
pub use limits::{AXES, AxisLimits, Limits};
pub use planner::Planner;
pub use segment::{Period, Segment, Train};
pub use sequencer::Sequencer;
