//! From a transfer function to a controller that has a wanted phase margin.
//!
//! The paper gives the laws (Eq. 7, 14) and no values. Both designs put the crossover as high as the sampling lets
//! them, and give the phase that is missing there: the lead compensator by its pole, the PID by its derivative. (Ours.)

mod lead;
mod pid;
mod printed;

pub use lead::Lead;
pub use pid::{Pid, Structure};
pub use printed::Printed;

/// The phase margin where no one asks for another, in degrees. (Ours.)
pub const PHASE_MARGIN: f64 = 60.0;
/// What the crossover is lowered by, again and again, until the margin is there.
const LOWER: f64 = 0.9;
/// How often. A crossover a hundred times lower than sampling would allow is no design.
const TRIES: usize = 44;
