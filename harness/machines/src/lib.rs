//! The machines. Each has a room of its own, which says what its boards are made of, what is said on its lines and what
//! it makes; `MACHINES` names them all. Whatever runs rigs knows machines by this registry only.

#[cfg(feature = "echo")]
mod echo;
mod engraver;
mod grbl;
pub mod kinds;
mod lathe;
pub mod motor;
mod servo;
#[cfg(test)]
mod testing;
pub mod workpiece;

pub use grbl::with_axes;
pub use lathe::{Axes, axes};

use torno_bus::Dialect;

use kinds::Kind;

/// A machine.
pub struct Machine {
    /// The kinds of boards that it is made of.
    kinds: &'static [Kind],
    /// What is said on its lines.
    dialect: &'static dyn Dialect,
    /// What a rig of it plays where no program is named: name and text.
    program: Option<(&'static str, &'static str)>,
    /// The rigs that are built in: name and text.
    rigs: &'static [(&'static str, &'static str)],
}

/// The machines that there are. The first rig of the first one is meant where none is named.
const MACHINES: &[&Machine] = &[
    &lathe::MACHINE,
    &servo::MACHINE,
    &grbl::MACHINE,
    &engraver::MACHINE,
    #[cfg(feature = "echo")]
    &echo::MACHINE,
];

/// The dialect of that name.
pub fn dialect(name: &str) -> Option<&'static dyn Dialect> {
    MACHINES.iter().map(|machine| machine.dialect).find(|dialect| dialect.name() == name)
}

/// The names of all dialects.
pub fn dialect_names() -> Vec<&'static str> {
    let mut names: Vec<&str> = MACHINES.iter().map(|machine| machine.dialect.name()).collect();
    // Machines that speak alike stand together.
    names.dedup();
    names
}

/// What a rig plays where no program is named, if a board of this kind is at the PC's port: name and text.
pub fn program(kind: &str) -> Option<(&'static str, &'static str)> {
    MACHINES.iter().find(|machine| machine.kinds.iter().any(|known| known.name == kind))?.program
}

/// The rigs that are built in: name and text.
pub fn rigs() -> impl Iterator<Item = (&'static str, &'static str)> {
    MACHINES.iter().flat_map(|machine| machine.rigs).copied()
}
