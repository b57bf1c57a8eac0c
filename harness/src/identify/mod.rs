//! Characterising the motors of a rig, and tuning their controllers.
//!
//! [`mod@bench`] drives a board's motor in its service mode and listens to its encoder, [`csv`] reads what somebody
//! else has measured. An [`Identification`] is what the methods make of either; [`tune`] goes on from there to a
//! controller, and shows it.

pub mod bench;
pub mod csv;
pub mod dac;
mod report;
pub mod tune;

pub use report::{Experiment, Identification, Method, MethodResult, Units};
