//! What the parts of a rig have in common: virtual time, lines and UARTs, the machines' dialects, the contract of a
//! board, the loop that steps it, and the records between a board's process and the harness.
//!
//! Nothing here does I/O, reads a clock or knows a runtime.

pub mod board;
pub mod clock;
pub mod lathe;
pub mod layout;
pub mod line;
pub mod record;
pub mod servo;
pub mod settings;
pub mod stepping;
pub mod time;
pub mod train;
pub mod uart;
