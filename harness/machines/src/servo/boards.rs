//! The kind of the stand's controller board.

use torno_slaves::{Servo, ServoSettings};

use crate::kinds::{Carriage, Kind, boxed, read};

/// Why its motor cannot be driven freely.
const NO_ROOM: &str = "has an axis that begins at the end of its travel: there is no room to drive it freely";

/// The controller with its motor, its screw and its encoder.
pub(super) const SERVO: Kind = Kind {
    name: "servo",
    settings: ServoSettings::declared,
    build: |settings, clock| Ok(boxed(Servo::new(&read(settings, ServoSettings::check)?, clock))),
    motor: |settings, _| read(settings, ServoSettings::check).map(|_| Err(NO_ROOM)),
    rehearsal: |_, _| Ok(None),
    full_drive: |settings, motor| {
        let settings = read(settings, ServoSettings::check)?;
        Ok((motor == 0).then_some(settings.drive.full.into()))
    },
    carriage: |settings, motor| {
        let settings = read(settings, ServoSettings::check)?;
        let mm_per_count = 1.0 / settings.counts(1.0);
        let bed_mm = Some((0.0, settings.plant.travel_mm));
        Ok((motor == 0).then_some(Carriage { mm_per_count, bed_mm, slide: None }))
    },
};
