//! An axis: a first-order lag from drive to speed, then an integrator, and a carriage between two end stops.

use torno_protocol::board::MotorStimulus;
use torno_protocol::time::Instant;

use crate::plant::shaft::Shaft;

/// A motor that moves a carriage.
///
/// This is the open loop. The paper's Eq. 11 has no pole at 0 because it was measured with the loop closed (Fig. 9):
/// ω² = Km/τ and 2ξω = 1/τ give τ = 0.71875 s and Km = 2.664 1/s.
///
/// Between motor and carriage there can be dead travel: after a reversal the carriage stands until the gap is taken up.
/// The gap opens with the flank in contact that pushes in the positive sense, so the first to find it is a motion in
/// the negative one. (Ours.) The carriage does not coast across it. (Ours: friction in the slides.)
#[derive(Clone, Debug)]
pub(crate) struct PositionMotor {
    shaft: Shaft,
    /// The motor's, in the carriage's units.
    position: f64,
    carriage: Carriage,
    at: Instant,
}

/// What the motor moves, all in units of position.
#[derive(Clone, Debug)]
struct Carriage {
    position: f64,
    /// It lies up to so far beyond the motor's position, in the positive sense: what a fault adds included.
    backlash: f64,
    /// The axis's own backlash.
    own_backlash: f64,
    /// The ends of travel lie so far from the middle.
    end: f64,
    /// What stops it: the ends of travel, or something before them.
    low: f64,
    high: f64,
}

impl PositionMotor {
    /// A carriage at rest in mid-travel, at 0, that can go as far as `end` either way.
    /// `full` is the speed that full drive tends to.
    pub(crate) const fn new(tau_s: f64, full: f64, end: f64) -> Self {
        let carriage = Carriage { position: 0.0, backlash: 0.0, own_backlash: 0.0, end, low: -end, high: end };
        Self { shaft: Shaft::new(tau_s, full), position: 0.0, carriage, at: Instant::START }
    }

    /// Lets the time up to `now` pass with the drive as it is.
    pub(crate) fn advance(&mut self, now: Instant) {
        let dt = now.since(self.at);
        self.at = now;
        // Between two turnings the motor goes one way, so its place at the end is its extreme.
        let Self { shaft, position, carriage, .. } = self;
        shaft.advance(dt, |lag, way| {
            *position += way;
            *position = carriage.follow(*position);
            if carriage.is_stopped(*position, lag.rate()) {
                lag.stop();
            }
        });
    }

    /// The speed that the drive tends to from now on at nominal supply, in units of position per second.
    pub(crate) const fn drive(&mut self, toward: f64) {
        self.shaft.drive(toward);
    }

    /// With friction, and a push in the negative sense, both in shares of the torque at standstill with full drive at
    /// nominal supply; with a supply that is a share of nominal.
    pub(crate) fn with_load(self, friction: f64, push: f64, supply: f64) -> Self {
        Self { shaft: self.shaft.with_load(friction, push).with_supply(supply), ..self }
    }

    /// With dead travel between motor and carriage.
    pub(crate) const fn with_backlash(mut self, way: f64) -> Self {
        self.carriage.own_backlash = way;
        self.carriage.backlash = way;
        self
    }

    /// Standing so far from mid-travel.
    pub(crate) const fn standing_at(mut self, position: f64) -> Self {
        self.position = position;
        self.carriage.position = position;
        self
    }

    /// Motor and carriage are so far from where they were taken to be.
    pub(crate) fn shift(&mut self, by: f64) {
        self.position += by;
        self.carriage.position += by;
    }

    /// Something happens to motor or axis; `way` is what so many counts are in units of position.
    pub(crate) fn disturb(&mut self, what: &MotorStimulus, way: impl Fn(i32) -> f64) {
        match what {
            MotorStimulus::Stall(blocked) => self.block(*blocked),
            MotorStimulus::Load(per_mille) => self.shaft.set_load(*per_mille),
            MotorStimulus::Supply(per_mille) => self.shaft.set_supply(*per_mille),
            MotorStimulus::Backlash(counts) => self.set_backlash(way(i32::from(*counts))),
            MotorStimulus::EndStop(counts) => self.set_stop(way(*counts)),
            _ => {}
        }
    }

    /// So much dead travel from now on beyond the axis's own. A gap that closes moves the carriage.
    fn set_backlash(&mut self, way: f64) {
        self.carriage.backlash = self.carriage.own_backlash + way;
        self.position = self.carriage.follow(self.position);
    }

    /// Something hard stops the carriage at `place` from now on, on that side of mid-travel; if it is beyond that,
    /// where it stands. 0: nothing but the ends of travel does.
    fn set_stop(&mut self, place: f64) {
        let Carriage { position, end, low, high, .. } = &mut self.carriage;
        if place > 0.0 {
            *high = place.min(*end).max(*position);
        } else if place < 0.0 {
            *low = place.max(-*end).min(*position);
        } else {
            (*low, *high) = (-*end, *end);
        }
    }

    /// Blocks the shaft, which stops dead, or frees it.
    const fn block(&mut self, blocked: bool) {
        self.shaft.block(blocked);
    }

    /// Up to when time has passed.
    pub(crate) const fn at(&self) -> Instant {
        self.at
    }

    /// The motor's position, where the carriage is without backlash.
    pub(crate) const fn position(&self) -> f64 {
        self.position
    }

    /// The motor's speed, in units of position per second.
    pub(crate) const fn rate(&self) -> f64 {
        self.shaft.rate()
    }

    /// Where the carriage is.
    pub(crate) const fn carriage(&self) -> f64 {
        self.carriage.position
    }

    /// The end stop that the carriage touches: +1, −1 or 0 for none. It closes a limit switch.
    pub(crate) fn end_stop(&self) -> i64 {
        let Carriage { position, end, .. } = self.carriage;
        i64::from(position >= end) - i64::from(position <= -end)
    }

    /// Where the motor comes to rest if it is not driven.
    pub(crate) fn coast_end(&self) -> f64 {
        self.carriage.limited(self.position + self.shaft.coast())
    }

    /// Where the carriage comes to rest then.
    pub(crate) fn carriage_coast_end(&self) -> f64 {
        self.carriage.pushed(self.coast_end())
    }
}

impl Carriage {
    /// Where it is once the motor has come to `motor`.
    fn pushed(&self, motor: f64) -> f64 {
        self.position.max(motor).min(motor + self.backlash)
    }

    /// Where it lets the motor go that would go to `motor`.
    fn limited(&self, motor: f64) -> f64 {
        motor.min(self.high).max(self.low - self.backlash)
    }

    /// Goes with the motor to `motor`, or as far as it can; gives where the motor is then.
    fn follow(&mut self, motor: f64) -> f64 {
        let motor = self.limited(motor);
        self.position = self.pushed(motor);
        motor
    }

    /// It does not let the motor go on from `motor` at `rate`.
    fn is_stopped(&self, motor: f64, rate: f64) -> bool {
        (motor >= self.high && rate > 0.0) || (motor <= self.low - self.backlash && rate < 0.0)
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Span;

    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    /// Fig. 9: proportional control with Kch LSB a count makes Eq. 11 of this plant.
    #[test]
    fn a_closed_loop_of_1_ms_overshoots_as_equation_11_does() {
        let mut motor = PositionMotor::new(0.71875, 7_500.0, 36_000.0);
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
            let mut motor = PositionMotor::new(0.1, 20.0, 10.0);
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
        let mut motor = PositionMotor::new(0.5, 30.0, 10.0);
        motor.drive(16.0);
        motor.advance(ms(1_000));
        let mut free = motor.clone();
        free.carriage.high = 1e9;
        motor.drive(-30.0);
        free.drive(-30.0);
        motor.advance(ms(1_600));
        free.advance(ms(1_600));
        // The free carriage went past 10 and came back; the other one lost its speed there and is ahead.
        assert!(free.position() < 10.0 && motor.position() < free.position(), "{motor:?} {free:?}");
    }

    #[test]
    fn a_blocked_shaft_stands() {
        let mut motor = PositionMotor::new(0.1, 20.0, 10.0);
        motor.drive(1.0);
        motor.advance(ms(1_000));
        let position = motor.position();
        motor.block(true);
        motor.advance(ms(3_000));
        assert_eq!((motor.position(), motor.coast_end()), (position, position));
    }

    /// The drives of a second each, from rest.
    fn driven(motor: &mut PositionMotor, drives: &[f64]) -> Vec<(f64, f64)> {
        let second = |drive: &f64| {
            motor.drive(*drive);
            motor.advance(motor.at + Span::from_secs(1));
            (motor.position(), motor.carriage())
        };
        drives.iter().map(second).collect()
    }

    #[test]
    fn the_carriage_stands_until_the_gap_is_taken_up() {
        let mut motor = PositionMotor::new(0.001, 20.0, 10.0);
        motor.set_backlash(0.5);
        let places = driven(&mut motor, &[1.0, -0.25, -1.0, 0.0, 0.25, 1.0, 0.0]);
        let expected = [(1.0, 1.0), (0.75, 1.0), (-0.25, 0.25), (-0.25, 0.25), (0.0, 0.25), (1.0, 1.0), (1.0, 1.0)];
        for ((motor, carriage), (m, c)) in places.into_iter().zip(expected) {
            assert!((motor - m).abs() < 2e-3 && (carriage - c).abs() < 2e-3, "{motor} {carriage}, not {m} {c}");
        }
        assert!((motor.carriage_coast_end() - motor.carriage()).abs() < 1e-12);
        // The gap closes.
        driven(&mut motor, &[-0.25]);
        assert!(motor.carriage() > motor.position() + 0.2);
        motor.set_backlash(0.0);
        assert_eq!(motor.carriage(), motor.position());
    }

    #[test]
    fn a_reversal_within_a_step_takes_up_the_gap_as_small_steps_do() {
        let motor = |ms: u64| {
            let mut motor = PositionMotor::new(0.4, 20.0, 1e6);
            motor.set_backlash(0.3);
            motor.shaft.set_load(50);
            for (second, drive) in (1..).zip([3.0, -6.0, 5.0, -2.0, 0.0, 0.0]) {
                motor.drive(drive);
                while motor.at < self::ms(second * 1_000) {
                    motor.advance(motor.at + Span::from_millis(ms));
                }
            }
            (motor.position(), motor.carriage())
        };
        let (at_once, cut) = (motor(1_000), motor(1));
        assert!((at_once.0 - cut.0).abs() < 1e-9 && (at_once.1 - cut.1).abs() < 1e-9, "{at_once:?} {cut:?}");
        assert!(at_once.1 > at_once.0, "{at_once:?}");
    }

    #[test]
    fn the_ends_of_travel_are_the_carriages() {
        for sign in [1.0, -1.0] {
            let mut motor = PositionMotor::new(0.1, 20.0, 10.0);
            motor.set_backlash(0.5);
            driven(&mut motor, &[20.0 * sign; 2]);
            assert_eq!((motor.carriage(), motor.end_stop()), (10.0 * sign, sign as i64));
            assert_eq!(motor.position(), if sign > 0.0 { 10.0 } else { -10.5 });
        }
    }

    #[test]
    fn a_chip_stops_it_and_closes_no_switch_until_it_is_removed() {
        for sign in [1.0, -1.0] {
            let mut motor = PositionMotor::new(0.1, 20.0, 10.0);
            motor.set_stop(4.0 * sign);
            driven(&mut motor, &[20.0 * sign; 2]);
            assert_eq!((motor.carriage(), motor.end_stop()), (4.0 * sign, 0));
            // On the other side there is none.
            driven(&mut motor, &[-20.0 * sign; 2]);
            assert_eq!((motor.carriage(), motor.end_stop()), (-10.0 * sign, -sign as i64));
            motor.set_stop(0.0);
            driven(&mut motor, &[20.0 * sign; 3]);
            assert_eq!(motor.carriage(), 10.0 * sign);
            // One that it is beyond already holds it there.
            driven(&mut motor, &[-sign, 0.0]);
            let there = motor.carriage();
            motor.set_stop(4.0 * sign);
            driven(&mut motor, &[20.0 * sign]);
            assert_eq!(motor.carriage(), there);
        }
    }

    #[test]
    fn half_the_supply_is_half_the_way() {
        let mut motors = [(); 2].map(|()| PositionMotor::new(0.1, 20.0, 1e6));
        motors[1].shaft.set_supply(500);
        let [full, half] = motors.map(|mut motor| driven(&mut motor, &[7.0])[0].0);
        assert!((full - 2.0 * half).abs() < 1e-12);
    }
}
