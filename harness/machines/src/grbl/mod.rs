//! The lathe behind a GRBL controller: the PC speaks G-code to it, and it speaks frames to the lathe's master.

mod boards;
mod dialect;

pub use boards::with_axes;

use torno_bus::Dialect;

use crate::Machine;

/// What is said on a controller's line, whatever it moves.
pub(crate) const DIALECT: &dyn Dialect = &dialect::Grbl;

/// The machine.
pub(crate) const MACHINE: Machine = Machine {
    kinds: &[boards::KIND],
    dialect: DIALECT,
    program: Some(("shaft.nc", include_str!("../../../builtin/shaft.nc"))),
    rigs: &[("lathe-grbl", include_str!("../../../builtin/lathe-grbl.toml"))],
};
