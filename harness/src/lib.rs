//! Emulates small serial-bus CNC machines: launches the boards of a rig, drives their time, gives the PC its serial
//! port, plays whole programs.
//!
//! [`rig`] is the running rig, [`engine`] decides how far each board may run, [`pace`] holds time back to the wall
//! clock, [`play`] plays a program through, [`live`] keeps a rig up for somebody's own software at the [`port`],
//! [`trace`] is the record of either. [`identify`] characterises the motors of a rig, and tunes their controllers.

mod channel;
pub mod condition;
pub mod control;
pub mod fault;
pub mod identify;
pub mod live;
pub mod observe;
pub mod pace;
pub mod play;
pub mod port;
mod ready;
pub mod recorder;
pub mod replay;
pub mod report;
pub mod rig;
pub mod scenario;
pub mod seat;
pub mod send;
pub mod servo;
pub mod session;
pub mod socket;
pub mod sweep;
pub mod text_file;
