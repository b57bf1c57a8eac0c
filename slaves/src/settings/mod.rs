//! The boards' settings: for each its plant, its drive, its encoder and its controller.
//!
//! What a plant, a drive and an encoder are is the machine; what a controller reckons with is the firmware's, and may
//! differ from it.

mod axis;
mod depth;
mod servo;
mod spindle;
mod timing;
mod transverse;

pub use depth::{DepthController, DepthDrive, DepthEncoder, DepthPlant, DepthSettings};
pub use servo::{KvOn, ServoController, ServoDrive, ServoEncoder, ServoPlant, ServoSettings};
pub use spindle::{LeadForm, SpindleController, SpindleDrive, SpindleEncoder, SpindlePlant, SpindleSettings};
pub use transverse::{
    Eq12, JudgedBy, PositionForm, PositionModel, SetPoint, TransverseController, TransverseDrive, TransverseEncoder,
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
        let mut settings = ServoSettings::default();
        settings.controller.tick_ms = 101;
        assert_eq!(
            settings.check().map_err(|wrong| wrong.to_string()),
            Err("controller.tick_ms: expected 1 to 100, found 101".to_owned())
        );
        let mut settings = DepthSettings::default();
        settings.controller.poll_ms = 0;
        assert_eq!(
            settings.check().map_err(|wrong| wrong.to_string()),
            Err("controller.poll_ms: expected 1 to 1000, found 0".to_owned())
        );
        let mut settings = TransverseSettings::default();
        settings.controller.accel_counts_per_sample2 = 0;
        let wrong = settings.check().unwrap_err();
        assert_eq!(wrong.to_string(), "controller.accel_counts_per_sample2: expected 1 to 225, found 0");
    }

    #[test]
    fn a_sample_is_not_later_than_the_next_one() {
        let mut settings = TransverseSettings::default();
        settings.controller.jitter_us = 30_000;
        assert_eq!(settings.check(), Ok(()));
        settings.controller.jitter_us = 30_001;
        let wrong = settings.check().unwrap_err().to_string();
        let expected = "controller.jitter_us: expected 0 to 30000, the time between two samples, found 30001";
        assert_eq!(wrong, expected);
        let mut settings = SpindleSettings::default();
        settings.plant.dead_ms = -1.0;
        let wrong = settings.check().unwrap_err().to_string();
        assert_eq!(wrong, "plant.dead_ms: expected 0 to 1000, found -1");
        let mut settings = ServoSettings::default();
        settings.controller.jitter_us = 5_001;
        assert!(settings.check().is_err());
    }

    #[test]
    fn a_push_may_have_either_sense_and_a_pole_either_sign() {
        for (sign, bad) in [(-2.0, -2.1), (2.0, 2.1)] {
            let message = format!("plant.load_torque: expected -2 to 2, found {bad}");
            let mut settings = TransverseSettings::default();
            settings.plant.load_torque = sign;
            assert_eq!(settings.check(), Ok(()));
            settings.plant.load_torque = bad;
            assert_eq!(settings.check().map_err(|wrong| wrong.to_string()), Err(message.clone()));
            let mut settings = DepthSettings::default();
            settings.plant.load_torque = sign;
            assert_eq!(settings.check(), Ok(()));
            settings.plant.load_torque = bad;
            assert_eq!(settings.check().map_err(|wrong| wrong.to_string()), Err(message.clone()));
            let mut settings = ServoSettings::default();
            settings.plant.load_torque = sign;
            assert_eq!(settings.check(), Ok(()));
            settings.plant.load_torque = bad;
            assert_eq!(settings.check().map_err(|wrong| wrong.to_string()), Err(message));
        }
        let mut settings = SpindleSettings::default();
        settings.controller.beta = 0.99;
        assert_eq!(settings.check(), Ok(()));
        settings.plant.friction = 2.1;
        assert_eq!(
            settings.check().map_err(|wrong| wrong.to_string()),
            Err("plant.friction: expected 0 to 2, found 2.1".to_owned())
        );
    }

    #[test]
    fn what_follows_from_the_settings() {
        let near =
            |found: f64, expected: f64| assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
        let mut feed = TransverseSettings::default();
        near(feed.full_counts_per_s(), 7_500.0);
        near(feed.sample_s(), 0.030);
        feed.plant.pitch_mm = 5.0;
        near(feed.counts(2.0), 360.0);
        let mut stand = ServoSettings::default();
        near(stand.full_counts_per_s(), 500.0 * 250.0 / 60.0);
        stand.plant.pitch_mm = 5.0;
        near(stand.counts(2.0), 100.0);
        let mut infeed = DepthSettings::default();
        near(infeed.speed_mm_per_s(), 16.0 / 60.0);
        near(infeed.slots_per_mm(), 5.625);
        // Three slots take 2 s.
        assert_eq!(infeed.stall_polls(), 200);
        infeed.controller.poll_ms = 7;
        assert_eq!(infeed.stall_polls(), 286);
        infeed.plant.rpm = 1_000.0;
        assert_eq!(infeed.stall_polls(), 29);
        infeed.controller.poll_ms = 1_000;
        assert_eq!(infeed.stall_polls(), 2);
    }
}
