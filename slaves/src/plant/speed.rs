//! The main motor: a first-order lag from volts to speed (Eq. 1 to 5).

use core::f64::consts::TAU;

use torno_protocol::time::Instant;

use crate::plant::lag::Lag;

/// A motor that is driven in one sense only and coasts when the drive is off (one power transistor, §4).
#[derive(Clone, Debug)]
pub(crate) struct SpeedMotor {
    /// Revolutions per second.
    lag: Lag,
    km_rad_per_s_volt: f64,
    toward: f64,
    angle_rev: f64,
    blocked: bool,
    at: Instant,
}

impl SpeedMotor {
    /// A motor at rest, with `km` in rad/(s·V) and τ in seconds.
    pub(crate) const fn new(km_rad_per_s_volt: f64, tau_s: f64) -> Self {
        let lag = Lag::new(tau_s);
        Self { lag, km_rad_per_s_volt, toward: 0.0, angle_rev: 0.0, blocked: false, at: Instant::START }
    }

    /// Lets the time up to `now` pass with the drive as it is.
    pub(crate) fn advance(&mut self, now: Instant) {
        let dt = now.since(self.at);
        self.at = now;
        if !self.blocked {
            self.angle_rev += self.lag.step(dt, self.toward);
        }
    }

    /// The mean voltage from now on.
    pub(crate) fn drive(&mut self, volts: f64) {
        self.toward = self.km_rad_per_s_volt * volts / TAU;
    }

    /// Blocks the shaft, which stops dead, or frees it.
    pub(crate) const fn block(&mut self, blocked: bool) {
        self.blocked = blocked;
        if blocked {
            self.lag.stop();
        }
    }

    pub(crate) const fn is_blocked(&self) -> bool {
        self.blocked
    }

    /// Revolutions since the start.
    pub(crate) const fn angle_rev(&self) -> f64 {
        self.angle_rev
    }

    /// Where the shaft comes to rest if it is not driven.
    pub(crate) fn coast_end_rev(&self) -> f64 {
        self.angle_rev + self.lag.coast()
    }

    /// Revolutions per minute.
    #[cfg(test)]
    pub(crate) fn rpm(&self) -> f64 {
        60.0 * self.lag.rate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motor(volts: f64, seconds: f64) -> SpeedMotor {
        let mut motor = SpeedMotor::new(19.0, 2.8);
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
