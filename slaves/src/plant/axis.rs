//! An axis as its firmware sees it: a motor that moves a carriage, and an encoder that counts one of the two.

use torno_protocol::board::{Capability, MotorStimulus};
use torno_protocol::time::Instant;

use crate::drive::{self, Bridge};
use crate::encoder::{Counter, Encoder};
use crate::plant::{DeadTime, Motion, Plant, PositionMotor, SampledPlant};

/// An axis with its encoder, and the count of it that the firmware has.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    motor: PositionMotor,
    /// Eq. 12, if it stands in the motor's place.
    sampled: Option<SampledPlant>,
    dead: DeadTime,
    /// What has reached the motor, in LSB.
    reached: f64,
    encoder: Encoder,
    counter: Counter,
    along_slide: bool,
    speed_per_lsb: f64,
    /// The fullest drive, in LSB.
    full: f64,
}

impl Axis {
    pub(crate) const CAPABILITIES: &[Capability] = &[Capability::Motor, Capability::Axis];

    /// An axis whose encoder is on the motor's shaft, so that it does not see backlash. `full` is the fullest drive,
    /// in LSB; `full_speed` is the speed that the motor tends to with it.
    pub(crate) fn new(motor: PositionMotor, encoder: Encoder, full_speed: f64, full: f64) -> Self {
        let counter = Counter::new(encoder);
        let speed_per_lsb = full_speed / full;
        let mut axis = Self {
            motor,
            sampled: None,
            dead: DeadTime::new(0.0),
            reached: 0.0,
            encoder,
            counter,
            along_slide: false,
            speed_per_lsb,
            full,
        };
        axis.restart(Instant::START);
        axis
    }

    /// The encoder lies along the slide, so that it sees what the slide does, backlash and all.
    pub(crate) const fn with_encoder_along_slide(mut self) -> Self {
        self.along_slide = true;
        self
    }

    /// A plant in the motor's place.
    pub(crate) fn with_sampled(self, sampled: Option<SampledPlant>) -> Self {
        Self { sampled, ..self }
    }

    /// With a dead time between drive and motor. Eq. 12 takes at a sample what has arrived by then.
    pub(crate) fn with_dead_time(self, ms: f64) -> Self {
        Self { dead: DeadTime::new(ms), ..self }
    }

    /// Drives the motor with so many LSB from now on, or from when its dead time is over.
    pub(crate) fn drive(&mut self, lsb: i64) {
        self.set(Bridge::set(lsb).drive());
        if let Some(plant) = &mut self.sampled {
            plant.step(self.reached);
        }
    }

    fn set(&mut self, lsb: f64) {
        if let Some(lsb) = self.dead.set(self.motor.at(), lsb) {
            self.put(lsb);
        }
    }

    fn put(&mut self, lsb: f64) {
        self.reached = lsb;
        if self.sampled.is_none() {
            self.motor.drive(self.speed_per_lsb * lsb);
        }
    }

    /// Lets the time up to `now` pass.
    fn pass(&mut self, now: Instant) {
        while let Some((at, lsb)) = self.dead.due(now) {
            self.motor.advance(at);
            self.put(lsb);
        }
        self.motor.advance(now);
    }

    /// Drives the motor no more. Eq. 12 finds out with its next step.
    pub(crate) fn switch_off(&mut self) {
        self.set(0.0);
    }

    /// The service mode's drive, in LSB.
    pub(crate) fn service(&self, per_mille: i32) -> i64 {
        drive::service(per_mille, self.full)
    }

    /// The carriage's place by the true count, however wrong the firmware's is.
    pub(crate) fn carriage(&self) -> i64 {
        self.encoder.count(self.sampled.as_ref().map_or(self.motor.carriage(), SampledPlant::position))
    }

    /// The end stop that the carriage touches: +1, −1 or 0 for none.
    pub(crate) fn end_stop(&self) -> i64 {
        self.sampled.as_ref().map_or(self.motor.end_stop(), SampledPlant::end_stop)
    }

    /// Not driven, it comes to rest with another count than this.
    pub(crate) fn leaves(&self, count: i64) -> bool {
        let end = if self.along_slide { self.motor.carriage_coast_end() } else { self.motor.coast_end() };
        let leaves = || self.sampled.as_ref().map_or(self.counter.count_at(end) != count, |plant| !plant.is_at_rest());
        self.dead.is_pending() || leaves()
    }

    /// The motor's place, in units of position.
    #[cfg(test)]
    pub(crate) const fn motor(&self) -> f64 {
        self.motor.position()
    }

    /// The carriage's place, in units of position.
    #[cfg(test)]
    pub(crate) const fn slide(&self) -> f64 {
        self.motor.carriage()
    }

    /// What the encoder sees.
    fn seen(&self) -> f64 {
        let motor = if self.along_slide { self.motor.carriage() } else { self.motor.position() };
        self.sampled.as_ref().map_or(motor, SampledPlant::position)
    }
}

impl Plant for Axis {
    fn advance(&mut self, now: Instant) -> i64 {
        self.pass(now);
        self.counter.count(self.seen())
    }

    fn disturb(&mut self, now: Instant, what: &MotorStimulus) {
        self.pass(now);
        match what {
            MotorStimulus::Counts(counts) => self.counter.invent(self.seen(), *counts),
            _ => self.motor.disturb(what, |counts| self.encoder.way(counts)),
        }
    }

    fn restart(&mut self, now: Instant) {
        self.pass(now);
        self.counter.restart(self.seen());
    }

    fn motion(&self) -> Motion {
        match self.sampled {
            None => {
                let coming = self.dead.under_way().map(|(at, lsb)| (at, self.speed_per_lsb * lsb));
                Motion::of_position(self.motor.clone(), self.encoder, self.along_slide).with(coming)
            }
            Some(_) => Motion::none(),
        }
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Span;

    use super::*;

    fn us(us: u64) -> Instant {
        Instant::START + Span::from_micros(us)
    }

    /// The motor that somebody drives by hand at the very instants at which the changes arrive.
    #[test]
    fn a_drive_reaches_the_motor_when_its_dead_time_is_over() {
        let drives = [200, 200, -30, 0, 255, 90];
        let motor = || PositionMotor::new(0.718_75, 7_500.0, 36_000.0).with_load(0.02, 0.0, 1.0);
        for dead_us in [0, 1, 12_500, 30_000, 71_234] {
            let mut axis =
                Axis::new(motor(), Encoder::new(1.0), 7_500.0, 255.0).with_dead_time(dead_us as f64 / 1_000.0);
            let mut by_hand = motor();
            for (n, lsb) in (0..).zip(drives) {
                let at = n * 30_000;
                // Looking at it in between changes nothing.
                for between in [at - at.min(7_000), at] {
                    axis.advance(us(between));
                }
                axis.drive(lsb);
                by_hand.advance(us(at + dead_us));
                by_hand.drive(lsb as f64 * 7_500.0 / 255.0);
            }
            assert_eq!(axis.leaves(axis.counter.count_at(axis.motor.coast_end())), dead_us > 0, "{dead_us}");
            axis.advance(us(900_000));
            by_hand.advance(us(900_000));
            assert!((axis.motor() - by_hand.position()).abs() < 1e-9, "{dead_us}");
            assert!(axis.motor() > 100.0);
        }
    }
}
