//! The lathe's master board (PIC16F877A): receives frames from the PC over its hardware UART, distributes them to
//! three motor slaves over three software UARTs, supervises the slaves, and holds the PC while any of them is busy.
//!
//! Peña & Martínez (2009), §3, gives the task; the conversation that fulfils it is ours and is told in
//! [`torno_protocol::lathe`].
//!
//! The [`Reception`] is the half of it that faces the PC. It does not know how frames are executed, so a board that
//! drives the motors itself has the same.

mod master;
mod reception;
mod supervision;

pub use master::{Master, MasterSettings};
pub use reception::{Beginning, Order, PC, Reception, START_UP, Slaves};
