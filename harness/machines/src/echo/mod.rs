//! The smallest machine: one board that sends back what the PC sends. It is there for tests only, and shows what a
//! machine consists of.

mod board;
mod dialect;

use crate::Machine;

/// The machine.
pub(crate) const MACHINE: Machine = Machine {
    kinds: &[board::KIND],
    dialect: &dialect::Echo,
    program: None,
    rigs: &[("echo", include_str!("echo.toml"))],
};
