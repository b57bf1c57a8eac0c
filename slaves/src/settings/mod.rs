//! The boards' settings: for each its plant, its drive, its encoder and its controller, and what all their checks have
//! in common.
//!
//! What a plant, a drive and an encoder are is the machine; what a controller reckons with is the firmware's, and may
//! differ from it.

mod depth;
mod servo;
mod spindle;
mod transverse;

pub use depth::{DepthController, DepthDrive, DepthEncoder, DepthPlant, DepthSettings};
pub use servo::{KvOn, ServoController, ServoDrive, ServoEncoder, ServoPlant, ServoSettings};
pub use spindle::{LeadForm, SpindleController, SpindleDrive, SpindleEncoder, SpindlePlant, SpindleSettings};
pub use transverse::{
    Eq12, PositionForm, PositionModel, SetPoint, TransverseController, TransverseDrive, TransverseEncoder,
    TransversePlant, TransverseSettings,
};

/// Accepts `found` from `least` to `most`. Not-a-number and the infinities lie outside every range.
pub(crate) fn within(field: &str, found: impl Into<f64>, least: f64, most: f64) -> Result<(), String> {
    let found = found.into();
    if found >= least && found <= most {
        return Ok(());
    }
    Err(format!("{field}: expected {least} to {most}, found {found}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_belong_to_the_range_and_nan_does_not() {
        assert_eq!(within("tau_s", 1.0, 1.0, 2.0), Ok(()));
        assert_eq!(within("tau_s", 2.0, 1.0, 2.0), Ok(()));
        assert_eq!(within("tau_s", 2.5, 1.0, 2.0), Err("tau_s: expected 1 to 2, found 2.5".to_owned()));
        assert!(within("tau_s", f64::NAN, 1.0, 2.0).is_err());
        assert!(within("tau_s", f64::INFINITY, 1.0, f64::MAX).is_err());
    }

    #[test]
    fn the_defaults_are_in_range_and_nonsense_is_named() {
        assert_eq!(SpindleSettings::default().check(), Ok(()));
        assert_eq!(TransverseSettings::default().check(), Ok(()));
        assert_eq!(DepthSettings::default().check(), Ok(()));
        let mut settings = SpindleSettings::default();
        settings.plant.tau_s = -1.0;
        assert_eq!(settings.check(), Err("plant.tau_s: expected 0.01 to 1000, found -1".to_owned()));
        let mut settings = TransverseSettings::default();
        settings.controller.accel_counts_per_sample2 = 0;
        let expected = "controller.accel_counts_per_sample2: expected 1 to 225, found 0";
        assert_eq!(settings.check(), Err(expected.to_owned()));
    }
}
