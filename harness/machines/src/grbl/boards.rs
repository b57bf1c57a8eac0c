//! The kind of the board.

use torno_grbl_board::{Grbl, GrblSettings};

use crate::kinds::{Kind, boxed, read};
use crate::motor::NO_MOTOR;

/// The kind of the board.
pub(super) const KIND: Kind = Kind {
    name: "grbl",
    settings: GrblSettings::declared,
    build: |settings, clock| Ok(boxed(Grbl::new(&read(settings, GrblSettings::check)?, clock))),
    motor: |settings, _| read(settings, GrblSettings::check).map(|_| Err(NO_MOTOR)),
    rehearsal: |_, _| Ok(None),
    carriage: |settings, _| read(settings, GrblSettings::check).map(|_| None),
};
