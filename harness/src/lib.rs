//! Emulates small serial-bus CNC machines: launches the boards of a rig, drives their time, gives the PC its serial
//! port, plays whole programs.
//!
//! [`session`] advances a rig; nothing else does. [`rig`] is the running rig, [`pace`] holds time back to the wall
//! clock, [`play`] plays a program, [`live`] keeps a rig up for other programs at its [ports](torno_port), [`replay`]
//! repeats a recording. [`steering`] lets people watch each of them, and steer it. [`identify`] characterises the
//! motors of a rig, and tunes their controllers.

mod backlog;
#[cfg(target_os = "linux")]
mod channel;
pub mod condition;
#[cfg(target_os = "linux")]
pub mod control;
pub mod fault;
pub mod identify;
pub mod job;
pub mod kept;
#[cfg(target_os = "linux")]
pub mod live;
pub mod observe;
pub mod pace;
#[cfg(target_os = "linux")]
pub mod page;
pub mod physical;
pub mod pins;
pub mod planning;
pub mod platform;
pub mod play;
pub mod preview;
#[cfg(target_os = "linux")]
mod ready;
pub mod recorder;
pub mod replay;
pub mod report;
pub mod rig;
pub mod saving;
pub mod scenario;
#[cfg(target_os = "linux")]
pub mod seat;
pub mod send;
pub mod servo;
pub mod session;
#[cfg(target_os = "linux")]
pub mod socket;
pub mod speed;
pub mod spool;
#[cfg(target_os = "linux")]
pub mod steering;
pub mod sweep;
pub mod text_file;
pub mod toolpath;
pub mod tracking;
mod traffic;
