//! A GRBL 1.1h controller as a state machine: bytes and the machine's progress in, bytes and motions out.
//!
//! It answers as the firmware 1.1h (20190830) does, line for line. It knows no clock and does no I/O; what moves is a
//! [`Machine`](machine::Machine).

pub mod axes;
pub mod code;
pub mod controller;
pub mod machine;
pub mod memory;
pub mod realtime;
pub mod state;

mod arc;
mod block;
mod eeprom;
mod execution;
mod line;
mod modal;
mod number;
mod path;
mod report;
mod settings;
mod steps;
mod system;
mod words;

pub use axes::Axes;
pub use block::Abilities;
pub use modal::Spindle;
pub use path::Rate;
