//! The main motor: a first-order lag from volts to speed (Eq. 1 to 5).

use core::f64::consts::TAU;

use torno_protocol::time::Instant;

use crate::plant::shaft::Shaft;

/// A motor that is driven in one sense only and coasts when the drive is off (one power transistor, §4).
#[derive(Clone, Debug)]
pub(crate) struct SpeedMotor {
    /// Revolutions per second.
    shaft: Shaft,
    km_rad_per_s_volt: f64,
    angle_rev: f64,
    at: Instant,
}

impl SpeedMotor {
    /// A motor at rest, with `km` in rad/(s·V), τ in seconds and full drive in volts.
    pub(crate) fn new(km_rad_per_s_volt: f64, tau_s: f64, full_v: f64) -> Self {
        let shaft = Shaft::new(tau_s, km_rad_per_s_volt * full_v / TAU);
        Self { shaft, km_rad_per_s_volt, angle_rev: 0.0, at: Instant::START }
    }

    /// With a load that opposes motion, as a share of the torque at standstill with full drive.
    pub(crate) fn with_load(self, share: f64) -> Self {
        Self { shaft: self.shaft.with_load(share, 0.0), ..self }
    }

    /// Lets the time up to `now` pass with the drive as it is.
    pub(crate) fn advance(&mut self, now: Instant) {
        let dt = now.since(self.at);
        self.at = now;
        self.shaft.advance(dt, |_, way| self.angle_rev += way);
    }

    /// The mean voltage from now on, at nominal supply: none below 0, the transistor does not brake.
    pub(crate) fn drive(&mut self, volts: f64) {
        self.shaft.drive(self.km_rad_per_s_volt * volts.max(0.0) / TAU);
    }

    /// The supply from now on, in per mille of nominal: it scales the voltage.
    pub(crate) const fn set_supply(&mut self, per_mille: u16) {
        self.shaft.set_supply(per_mille);
    }

    /// A further load that opposes motion from now on, in per mille of the torque at standstill with full drive.
    pub(crate) fn set_load(&mut self, per_mille: i32) {
        self.shaft.set_load(per_mille);
    }

    /// Blocks the shaft, which stops dead, or frees it.
    pub(crate) const fn block(&mut self, blocked: bool) {
        self.shaft.block(blocked);
    }

    /// Whatever the drive, the shaft does not turn: it is blocked, or loaded beyond what the motor can do.
    pub(crate) fn is_held(&self) -> bool {
        self.shaft.is_blocked() || self.shaft.is_overloaded()
    }

    /// Up to when time has passed.
    pub(crate) const fn at(&self) -> Instant {
        self.at
    }

    /// Revolutions since the start.
    pub(crate) const fn angle_rev(&self) -> f64 {
        self.angle_rev
    }

    /// Where the shaft comes to rest if it is not driven.
    pub(crate) fn coast_end_rev(&self) -> f64 {
        self.angle_rev + self.shaft.coast()
    }

    /// Revolutions per second.
    pub(crate) const fn rate(&self) -> f64 {
        self.shaft.rate()
    }

    /// Revolutions per minute.
    #[cfg(test)]
    pub(crate) fn rpm(&self) -> f64 {
        60.0 * self.shaft.rate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motor(volts: f64, seconds: f64) -> SpeedMotor {
        let mut motor = SpeedMotor::new(19.0, 2.8, 30.0);
        motor.drive(volts);
        motor.advance(seconds_from_start(seconds));
        motor
    }

    fn seconds_from_start(seconds: f64) -> Instant {
        Instant::from_nanos((seconds * 1e9) as u64)
    }

    #[test]
    fn thirty_volts_give_5443_rpm() {
        assert!((motor(30.0, 100.0).rpm() - 5_443.099_1).abs() < 1e-3);
        assert!((motor(1.102_313, 100.0).rpm() - 200.0).abs() < 1e-3);
        assert!((motor(22.046_264, 100.0).rpm() - 4_000.0).abs() < 1e-3);
    }

    #[test]
    fn full_voltage_reaches_90_per_cent_of_4000_rpm_in_3_s() {
        assert!((motor(30.0, 0.213_718).rpm() - 400.0).abs() < 0.05);
        assert!((motor(30.0, 3.032_120).rpm() - 3_600.0).abs() < 0.05);
        assert!((motor(30.0, 3.566_084).rpm() - 3_920.0).abs() < 0.05);
    }

    #[test]
    fn a_load_takes_its_share_of_full_speed_and_a_sag_its_share_of_the_voltage() {
        let mut motor = motor(30.0, 1.0);
        motor.set_load(200);
        motor.advance(seconds_from_start(200.0));
        assert!((motor.rpm() - 0.8 * 5_443.099_1).abs() < 1e-3);
        motor.set_supply(500);
        motor.advance(seconds_from_start(400.0));
        assert!((motor.rpm() - 0.3 * 5_443.099_1).abs() < 1e-3);
        // Not driven it stands after τ·ln(1 + 0.3/0.2), and never turns back.
        motor.drive(0.0);
        motor.advance(seconds_from_start(402.565));
        assert!(motor.rpm() > 0.0 && !motor.is_held());
        motor.advance(seconds_from_start(402.566));
        assert_eq!(motor.rpm(), 0.0);
        let angle = motor.angle_rev();
        motor.advance(seconds_from_start(500.0));
        assert_eq!((motor.angle_rev(), motor.coast_end_rev()), (angle, angle));
    }

    #[test]
    fn coasts_from_4000_to_200_rpm_in_8_s() {
        let mut motor = motor(22.046_264, 100.0);
        motor.drive(0.0);
        motor.advance(seconds_from_start(108.388_050));
        assert!((motor.rpm() - 200.0).abs() < 1e-3);
    }

    #[test]
    fn a_blocked_shaft_stands_and_then_starts_from_rest() {
        let mut motor = motor(22.0, 10.0);
        let angle = motor.angle_rev();
        motor.block(true);
        motor.advance(seconds_from_start(12.0));
        assert_eq!((motor.angle_rev(), motor.rpm()), (angle, 0.0));
        motor.block(false);
        motor.advance(seconds_from_start(12.1));
        assert!(motor.rpm() > 0.0 && motor.rpm() < 200.0);
    }
}
