//! An axis: a first-order lag from drive to speed, then an integrator between two end stops.

use torno_protocol::time::{Instant, Span};

use crate::plant::lag::Lag;

/// A motor that moves a carriage.
///
/// This is the open loop. The paper's Eq. 11 has no pole at 0 because it was measured with the loop closed (Fig. 9):
/// ω² = Km/τ and 2ξω = 1/τ give τ = 0.71875 s and Km = 2.664 1/s.
#[derive(Clone, Debug)]
pub(crate) struct PositionMotor {
    lag: Lag,
    toward: f64,
    position: f64,
    end: f64,
    blocked: bool,
    at: Instant,
}

impl PositionMotor {
    /// A carriage at rest in mid-travel, at 0, that can go as far as `end` either way.
    pub(crate) const fn new(tau_s: f64, end: f64) -> Self {
        let lag = Lag::new(tau_s);
        Self { lag, toward: 0.0, position: 0.0, end, blocked: false, at: Instant::START }
    }

    /// Lets the time up to `now` pass with the drive as it is.
    pub(crate) fn advance(&mut self, now: Instant) {
        let dt = now.since(self.at);
        self.at = now;
        if self.blocked {
            return;
        }
        // Between two turnings the carriage goes one way, so its place at the end is its extreme.
        match self.lag.turning(self.toward).filter(|turning| *turning < dt) {
            Some(turning) => {
                self.travel(turning);
                self.travel(Span::from_nanos(dt.as_nanos() - turning.as_nanos()));
            }
            None => self.travel(dt),
        }
    }

    fn travel(&mut self, dt: Span) {
        self.position += self.lag.step(dt, self.toward);
        if self.position >= self.end || self.position <= -self.end {
            self.position = if self.position > 0.0 { self.end } else { -self.end };
            if self.lag.rate() * self.position > 0.0 {
                self.lag.stop();
            }
        }
    }

    /// The speed that the drive tends to from now on, in units of position per second.
    pub(crate) const fn drive(&mut self, toward: f64) {
        self.toward = toward;
    }

    /// Blocks the shaft, which stops dead, or frees it.
    pub(crate) const fn block(&mut self, blocked: bool) {
        self.blocked = blocked;
        if blocked {
            self.lag.stop();
        }
    }

    pub(crate) const fn position(&self) -> f64 {
        self.position
    }

    /// The end stop that the carriage touches: +1, −1 or 0 for none. It closes a limit switch.
    pub(crate) fn end_stop(&self) -> i64 {
        i64::from(self.position >= self.end) - i64::from(self.position <= -self.end)
    }

    /// Where the carriage comes to rest if it is not driven.
    pub(crate) fn coast_end(&self) -> f64 {
        self.position + self.lag.coast()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    /// Fig. 9: proportional control with Kch LSB a count makes Eq. 11 of this plant.
    #[test]
    fn a_closed_loop_of_1_ms_overshoots_as_equation_11_does() {
        let mut motor = PositionMotor::new(0.71875, 36_000.0);
        let (mut peak, mut peak_at) = (0.0, 0);
        for t in 0..8_000 {
            motor.drive(2.664_161_814 * (900.0 - motor.position()));
            motor.advance(ms(t + 1));
            if motor.position() > peak {
                (peak, peak_at) = (motor.position(), t + 1);
            }
        }
        assert!((peak / 9.0 - 129.66).abs() < 0.2, "{peak}");
        assert!((1_740..=1_760).contains(&peak_at), "{peak_at}");
    }

    #[test]
    fn the_end_stops_hold_and_let_go() {
        for sign in [1.0, -1.0] {
            let mut motor = PositionMotor::new(0.1, 10.0);
            motor.drive(20.0 * sign);
            motor.advance(ms(2_000));
            assert_eq!((motor.position(), motor.end_stop()), (10.0 * sign, sign as i64));
            motor.drive(-sign);
            motor.advance(ms(2_100));
            assert_eq!(motor.end_stop(), 0);
            // One time constant at unit speed covers τ/e.
            assert!((motor.position() - sign * (10.0 - 0.036_788)).abs() < 1e-6);
        }
    }

    #[test]
    fn an_end_stop_reached_and_left_in_one_step_is_not_run_through() {
        let mut motor = PositionMotor::new(0.5, 10.0);
        motor.drive(16.0);
        motor.advance(ms(1_000));
        let mut free = PositionMotor { end: 1e9, ..motor.clone() };
        motor.drive(-30.0);
        free.drive(-30.0);
        motor.advance(ms(1_600));
        free.advance(ms(1_600));
        // The free carriage went past 10 and came back; the other one lost its speed there and is ahead.
        assert!(free.position() < 10.0 && motor.position() < free.position(), "{motor:?} {free:?}");
    }

    #[test]
    fn a_blocked_shaft_stands() {
        let mut motor = PositionMotor::new(0.1, 10.0);
        motor.drive(1.0);
        motor.advance(ms(1_000));
        let position = motor.position();
        motor.block(true);
        motor.advance(ms(3_000));
        assert_eq!((motor.position(), motor.coast_end()), (position, position));
    }
}
