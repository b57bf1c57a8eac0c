//! The lathe: Peña & Martínez, *Sistema electrónico de control de un torno CNC didáctico* (2009).

mod axes;
mod boards;
mod cable;
mod dialect;

pub use axes::{Axes, axes};

use crate::Machine;

/// The lathe, with four boards or with one.
pub(crate) const MACHINE: Machine = Machine {
    kinds: &boards::KINDS,
    dialect: &dialect::Lathe,
    program: Some(("shaft.frames", include_str!("../../../builtin/shaft.frames"))),
    rigs: &[
        ("lathe", include_str!("../../../builtin/lathe.toml")),
        ("lathe-dspic", include_str!("../../../builtin/lathe-dspic.toml")),
    ],
};
