//! The engraver: one board that speaks GRBL and moves four closed-loop stepper axes.

mod boards;

use crate::{Machine, grbl};

/// The machine.
pub(crate) const MACHINE: Machine = Machine {
    kinds: &[boards::KIND],
    dialect: grbl::DIALECT,
    program: Some(("rosette.nc", include_str!("../../../builtin/rosette.nc"))),
    rigs: &[("engraver", include_str!("../../../builtin/engraver.toml"))],
};
