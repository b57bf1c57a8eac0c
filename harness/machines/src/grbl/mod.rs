//! The lathe behind a GRBL controller: the PC speaks G-code to it, and it speaks frames to the lathe's master.

mod boards;
mod dialect;

use crate::Machine;

/// The machine.
pub(crate) const MACHINE: Machine = Machine {
    kinds: &[boards::KIND],
    dialect: &dialect::Grbl,
    rigs: &[("lathe-grbl", include_str!("../../../builtin/lathe-grbl.toml"))],
};
