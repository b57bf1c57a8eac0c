//! The boards' settings: for each its plant, its drive, its encoder and its controller.
//!
//! What a plant, a drive and an encoder are is the machine; what a controller reckons with is the firmware's, and may
//! differ from it.

mod axis;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_in_range_and_nonsense_is_named() {
        assert_eq!(SpindleSettings::default().check(), Ok(()));
        assert_eq!(TransverseSettings::default().check(), Ok(()));
        assert_eq!(DepthSettings::default().check(), Ok(()));
        assert_eq!(ServoSettings::default().check(), Ok(()));
        let mut settings = SpindleSettings::default();
        settings.plant.tau_s = -1.0;
        let wrong = settings.check().unwrap_err();
        assert_eq!(wrong.to_string(), "plant.tau_s: expected 0.01 to 1000, found -1");
        let mut settings = TransverseSettings::default();
        settings.controller.accel_counts_per_sample2 = 0;
        let wrong = settings.check().unwrap_err();
        assert_eq!(wrong.to_string(), "controller.accel_counts_per_sample2: expected 1 to 225, found 0");
    }
}
