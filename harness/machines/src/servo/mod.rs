//! The servo stand of a lab exercise.

mod boards;
mod dialect;

use crate::Machine;

/// The servo stand.
pub(crate) const MACHINE: Machine = Machine {
    kinds: &[boards::SERVO],
    dialect: &dialect::Servo,
    program: None,
    rigs: &[("servo", include_str!("../../../builtin/servo.toml"))],
};
