//! A board's axis as seen from the machine: how far its carriage goes.

use torno_slaves::{DepthSettings, TransverseSettings};

use super::{KindError, Settings, settings_of};

/// How far the carriage of a board of that kind goes for each count of a quantity, in mm, by its screw and its encoder;
/// None if the quantity counts no carriage. `settings` is TOML.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn mm_per_count(kind: &str, settings: &str, quantity: &str) -> Result<Option<f64>, KindError> {
    let feed = |settings: &TransverseSettings| 1.0 / settings.counts(1.0);
    let infeed = |settings: &DepthSettings| 1.0 / settings.slots_per_mm();
    let counts = |quantity: &str| ["position_counts", "carriage_offset_counts"].contains(&quantity);
    Ok(match settings_of(kind, settings)? {
        Settings::Transverse(settings) if counts(quantity) => Some(feed(&settings)),
        Settings::Depth(settings) if counts(quantity) => Some(infeed(&settings)),
        Settings::Servo(settings) if counts(quantity) => Some(1.0 / settings.counts(1.0)),
        Settings::Dspic(settings) => match quantity.split_once('_') {
            Some(("transverse", quantity)) if counts(quantity) => Some(feed(&settings.transverse)),
            Some(("depth", quantity)) if counts(quantity) => Some(infeed(&settings.depth)),
            _ => None,
        },
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_is_what_screw_and_encoder_make_of_it() {
        let worth = |kind: &str, settings: &str, quantity: &str| mm_per_count(kind, settings, quantity).unwrap();
        assert_eq!(worth("transverse", "", "position_counts"), Some(2.0 / 900.0));
        assert_eq!(worth("transverse", "plant.pitch_mm = 1.0", "position_counts"), Some(1.0 / 900.0));
        assert_eq!(worth("depth", "encoder.slots = 450", "carriage_offset_counts"), Some(160.0 / 450.0));
        assert_eq!(worth("dspic", "depth.encoder.slots = 600", "depth_position_counts"), Some(160.0 / 600.0));
        assert_eq!(worth("dspic", "transverse.plant.pitch_mm = 4.0", "transverse_position_counts"), Some(4.0 / 900.0));
        assert_eq!(worth("servo", "", "position_counts"), Some(1.0 / 125.0));
        assert_eq!(worth("dspic", "", "spindle_speed_rpm"), None);
        assert_eq!(worth("spindle", "", "position_counts"), None);
        assert!(mm_per_count("lathe", "", "position_counts").is_err());
    }
}
