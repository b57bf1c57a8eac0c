//! The kind of the board.

use torno_engraver::{EngraverSettings, engraver};

use crate::kinds::{Carriage, Kind, boxed, read};

/// Why its motors cannot be driven freely.
const STEPPERS: &str = "has stepper motors: they go where their pulses say, and have no response to measure";

/// The board with its axes.
pub(super) const KIND: Kind = Kind {
    name: "engraver",
    settings: EngraverSettings::declared,
    build: |settings, clock| Ok(boxed(engraver(&read(settings, EngraverSettings::check)?, clock))),
    motor: |settings, _| read(settings, EngraverSettings::check).map(|_| Err(STEPPERS)),
    rehearsal: |_, _| Ok(None),
    carriage: |settings, motor| {
        let settings = read(settings, EngraverSettings::check)?;
        let count_pm = |motor: u8| settings.axis(motor.into()).scale().count_pm();
        let mm = |motor: u8| Carriage { mm_per_count: count_pm(motor) as f64 / 1e9, slide: None };
        Ok((u32::from(motor) < settings.axes).then(|| mm(motor)))
    },
};
