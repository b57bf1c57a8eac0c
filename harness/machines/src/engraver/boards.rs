//! The kind of the board.

use torno_engraver::{EngraverSettings, engraver};

use crate::kinds::{Carriage, Kind, boxed, read};

/// Why its motors cannot be driven freely.
const STEPPERS: &str = "has stepper motors: they go where their pulses say, and have no response to measure";

/// The place of the axis that turns.
const TURNS: usize = 3;

/// The board with its axes.
pub(super) const KIND: Kind = Kind {
    name: "engraver",
    settings: EngraverSettings::declared,
    build: |settings, clock| Ok(boxed(engraver(&read(settings, EngraverSettings::check)?, clock))),
    motor: |settings, _| read(settings, EngraverSettings::check).map(|_| Err(STEPPERS)),
    rehearsal: |_, _| Ok(None),
    full_drive: |_, _| Ok(None),
    carriage: |settings, motor| {
        let settings = read(settings, EngraverSettings::check)?;
        let carriage = || {
            let axis = settings.axis(motor.into());
            let half = axis.mechanics.travel_mm / 2.0;
            let bed_mm = (usize::from(motor) < TURNS).then_some((-half, half));
            Carriage { mm_per_count: axis.scale().count_pm() as f64 / 1e9, bed_mm, slide: None }
        };
        Ok((u32::from(motor) < settings.axes).then(carriage))
    },
};
