//! What a control law is given and what it gives, sample by sample, on the board's own firmware: for other firmware
//! that is to do the same.

use crate::control::STANDS_MS;
use crate::settings::{SpindleSettings, TransverseSettings};

/// The share of what a stuck axis gained that an axis keeps when it moves.
pub use crate::control::KEPT;

/// A law in numbers, and a rehearsal of it.
#[derive(Clone, Debug, PartialEq)]
pub enum Rehearsal {
    /// The compensator of a main motor.
    Speed(SpeedLaw, Vec<SpeedSample>),
    /// The PID of a feed axis.
    Feed(FeedLaw, Vec<FeedSample>),
}

/// c(k) = −β·c(k−1) + K·(e(k) − α·e(k−1)), u(k) = u(k−1) + c(k).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedLaw {
    /// The zero.
    pub alpha: f64,
    /// The pole, negated.
    pub beta: f64,
    /// In LSB of drive per rpm.
    pub k: f64,
    /// What a count in a window is, in rpm.
    pub rpm_per_count: f64,
    /// What a unit of the set point is, in rpm.
    pub rpm_per_unit: f64,
    /// Full drive, in LSB.
    pub full: i64,
}

/// One window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpeedSample {
    /// The set point, in its unit.
    pub set_point: i64,
    /// The counts of the window.
    pub counts: i64,
    /// In LSB.
    pub drive: i64,
}

/// Eq. 14 with its feed-forward and its rules against friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeedLaw {
    /// In LSB per count.
    pub k1: f64,
    /// In LSB per count and s.
    pub k2: f64,
    /// In LSB·s per count.
    pub k3: f64,
    /// K2 while set point and axis stand.
    pub k2_standing: f64,
    /// How fast the integral's growth grows while the axis is stuck, in LSB/s².
    pub breakaway: f64,
    /// In counts.
    pub dead_band: i64,
    /// A larger error is not integrated, in counts.
    pub zone: i64,
    /// In LSB per count a sample of the set point's speed.
    pub per_speed: f64,
    /// In LSB per count a sample² of its acceleration.
    pub per_acceleration: f64,
    /// The time between samples, in s.
    pub sample_s: f64,
    /// After so many samples without a count an axis stands.
    pub stands_samples: i64,
    /// Full drive, in LSB.
    pub full: i64,
}

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FeedSample {
    /// The set point less the count.
    pub error: i64,
    /// The set point's speed, in counts a sample.
    pub speed: i64,
    /// The set point's acceleration, in counts a sample².
    pub acceleration: i64,
    /// The set point stands at its target.
    pub finished: bool,
    /// The axis has counted since the sample before.
    pub moved: bool,
    /// In LSB.
    pub drive: i64,
}

impl SpeedLaw {
    pub(crate) fn of(settings: &SpindleSettings) -> Self {
        let controller = &settings.controller;
        let full = crate::drive::full(settings.drive.bits);
        let rad_per_s = core::f64::consts::TAU / 60.0;
        Self {
            alpha: controller.alpha,
            beta: controller.beta,
            k: controller.k * rad_per_s / controller.supply_v * full,
            rpm_per_count: settings.rpm_per_count(),
            rpm_per_unit: f64::from(torno_protocol::lathe::SpindleSubFrame::RPM_PER_UNIT),
            full: full as i64,
        }
    }
}

impl FeedLaw {
    pub(crate) fn of(settings: &TransverseSettings) -> Self {
        let controller = &settings.controller;
        let sample_s = settings.sample_s();
        let stands = f64::from(STANDS_MS) / 1_000.0;
        Self {
            k1: controller.k1,
            k2: controller.k2,
            k3: controller.k3,
            k2_standing: controller.k2_standing,
            breakaway: controller.breakaway,
            dead_band: i64::from(controller.dead_band_counts.min(controller.in_position_counts)),
            zone: i64::from(controller.integral_zone_counts),
            per_speed: controller.kv / sample_s,
            per_acceleration: controller.ka / (sample_s * sample_s),
            sample_s,
            // The first number that the law takes for it.
            stands_samples: (0..).find(|n| f64::from(*n) * sample_s >= stands).map_or(i64::MAX, i64::from),
            full: crate::drive::full(settings.drive.bits) as i64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{LeadForm, PositionForm};

    #[test]
    fn an_axis_stands_after_as_many_samples_as_fill_the_time() {
        let after = |sample_ms: u32| {
            let mut settings = TransverseSettings::default();
            settings.controller.sample_ms = sample_ms;
            FeedLaw::of(&settings).stands_samples
        };
        assert_eq!([30, 50, 240, 250].map(after), [8, 5, 1, 1]);
    }

    #[test]
    fn the_gain_of_a_speed_is_in_lsb_per_rpm() {
        let mut settings = SpindleSettings::default();
        let full = crate::drive::full(settings.drive.bits);
        // Full drive for one turn a second.
        settings.controller.k = settings.controller.supply_v / core::f64::consts::TAU;
        let law = SpeedLaw::of(&settings);
        assert!((60.0 * law.k / full - 1.0).abs() < 1e-12, "{}", law.k);
    }

    #[test]
    fn only_the_working_form_of_a_law_is_rehearsed() {
        let feed = |form| {
            let mut settings = TransverseSettings::default();
            settings.controller.form = form;
            Rehearsal::of_feed(&settings).is_some()
        };
        assert_eq!([PositionForm::Pid, PositionForm::Literal, PositionForm::Open].map(feed), [true, false, false]);
        let speed = |form| {
            let mut settings = SpindleSettings::default();
            settings.controller.form = form;
            Rehearsal::of_speed(&settings).is_some()
        };
        assert_eq!([LeadForm::Incremental, LeadForm::Literal].map(speed), [true, false]);
    }
}
