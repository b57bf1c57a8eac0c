//! The PC program of the servo stand: what Servo v1.0 of the lab sheet does, on the rig or at any serial port.
//!
//! [`mod@line`] is the serial line, of a rig in virtual time or of this computer; [`controller`] asks and tells the
//! controller over it; [`report`] is what is left of a run, [`contour`] makes two stands the axes of one machine.
//! Nothing here knows whether a person, a test or a panel has asked for it.

pub mod contour;
pub mod controller;
pub mod line;
pub mod report;

pub use controller::{Controller, ControllerError, Gain, RunEnd, Sample};
pub use line::{LineError, RigLine, SerialDevice, ServoLine};
pub use report::Report;
