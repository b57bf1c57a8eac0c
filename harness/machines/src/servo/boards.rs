//! The kind of the stand's controller board.

use torno_slaves::{Servo, ServoSettings};

use crate::kinds::{Kind, boxed, read};

/// The controller with its motor, its screw and its encoder. Its axis begins at the end of its travel: there is no room
/// for a bench.
pub(super) const SERVO: Kind = Kind {
    name: "servo",
    settings: ServoSettings::declared,
    build: |settings, clock| Ok(boxed(Servo::new(&read(settings, ServoSettings::check)?, clock))),
    motor: |settings, _| read(settings, ServoSettings::check).map(|_| None),
    mm_per_count: |settings, motor| {
        let settings = read(settings, ServoSettings::check)?;
        Ok((motor == 0).then(|| 1.0 / settings.counts(1.0)))
    },
};
