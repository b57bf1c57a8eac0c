//! The PC's side of the cable, inside the rig: its UART, and a program behind it.

mod replies;
mod uart;

pub use replies::Replies;
pub use uart::{BAUD, Outside, PcEvent, PcProgram, PcUart, RECEIVED, STOPPED};
