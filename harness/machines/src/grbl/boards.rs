//! The kind of the board.

use toml::{Table, Value};
use torno_grbl_board::{Grbl, GrblSettings};

use crate::Axes;
use crate::kinds::{Kind, boxed, read};
use crate::motor::NO_MOTOR;

/// The kind of the board.
pub(super) const KIND: Kind = Kind {
    name: "grbl",
    settings: GrblSettings::declared,
    build: |settings, clock| Ok(boxed(Grbl::new(&read(settings, GrblSettings::check)?, clock))),
    motor: |settings, _| read(settings, GrblSettings::check).map(|_| Err(NO_MOTOR)),
    rehearsal: |_, _| Ok(None),
    full_drive: |_, _| Ok(None),
    carriage: |settings, _| read(settings, GrblSettings::check).map(|_| None),
};

/// The settings (TOML) of a board of that kind in a rig whose boards move these axes: what a controller has to know of
/// them, and its own settings do not say, is what they are.
pub fn with_axes(kind: &str, settings: &str, axes: &[Axes]) -> String {
    let Some(mut all) = settings.parse::<Table>().ok().filter(|_| kind == KIND.name) else {
        return settings.to_owned();
    };
    let mut put = |axis: &str, values: &[(&str, f64)]| {
        let own = all.entry(axis).or_insert_with(|| Value::Table(Table::new()));
        for (name, value) in values {
            own.as_table_mut().map(|own| own.entry(*name).or_insert(Value::Float(*value)));
        }
    };
    if let Some((_, infeed)) = axes.iter().find_map(|axes| axes.infeed) {
        let slot = infeed.mm_per_slot.abs();
        let travel = 2.0 * infeed.reach as f64 * slot;
        let speed = infeed.mm_per_s * 60.0;
        let overrun = infeed.overrun;
        put(
            "x",
            &[("slots_per_mm", 1.0 / slot), ("mm_per_min", speed), ("overrun_slots", overrun), ("travel_mm", travel)],
        );
    }
    if let Some((_, feed)) = axes.iter().find_map(|axes| axes.feed) {
        let count = feed.mm_per_count.abs();
        let travel = 2.0 * feed.reach as f64 * count;
        put("z", &[("counts_per_mm", 1.0 / count), ("sample_ms", 1_000.0 * feed.sample_s), ("travel_mm", travel)]);
    }
    toml::to_string(&all).unwrap_or_else(|_| settings.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes;

    #[test]
    fn a_controller_is_told_of_the_axes_unless_its_settings_say_something_else() {
        let axes = [axes("transverse", "plant.pitch_mm = 1.0").unwrap(), axes("depth", "").unwrap()];
        let told = with_axes("grbl", "x.travel_mm = 80.0", &axes).parse::<Table>().unwrap();
        let of = |axis: &str, name: &str| (told[axis][name].as_float().unwrap() * 1e6).round() / 1e6;
        assert_eq!((of("z", "counts_per_mm"), of("z", "sample_ms"), of("z", "travel_mm")), (900.0, 30.0, 160.0));
        assert_eq!((of("x", "slots_per_mm"), of("x", "mm_per_min"), of("x", "travel_mm")), (5.625, 16.0, 80.0));
        assert_eq!(with_axes("master", "answer_ms = 20", &axes), "answer_ms = 20");
    }
}
