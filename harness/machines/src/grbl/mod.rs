//! The lathe behind a GRBL controller: the PC speaks G-code to it, and it speaks frames to the lathe's master.

mod boards;
mod dialect;

pub use boards::with_axes;

use crate::Machine;

/// The machine.
pub(crate) const MACHINE: Machine = Machine {
    kinds: &[boards::KIND],
    dialect: &dialect::Grbl,
    rigs: &[("lathe-grbl", include_str!("../../../builtin/lathe-grbl.toml"))],
};
