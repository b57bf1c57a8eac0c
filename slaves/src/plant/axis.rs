//! An axis as its firmware sees it: a motor that moves a carriage, and an encoder that counts one of the two.

use torno_protocol::board::{Capability, MotorStimulus};
use torno_protocol::time::Instant;

use crate::drive::{self, Bridge};
use crate::encoder::{Counter, Encoder};
use crate::plant::{Motion, Plant, PositionMotor, SampledPlant};

/// An axis with its encoder, and the count of it that the firmware has.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    motor: PositionMotor,
    /// Eq. 12, if it stands in the motor's place.
    sampled: Option<SampledPlant>,
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
        let mut axis = Self { motor, sampled: None, encoder, counter, along_slide: false, speed_per_lsb, full };
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

    /// Drives the motor with so many LSB from now on.
    pub(crate) fn drive(&mut self, lsb: i64) {
        let lsb = Bridge::set(lsb).drive();
        match &mut self.sampled {
            None => self.motor.drive(self.speed_per_lsb * lsb),
            Some(plant) => plant.step(lsb),
        }
    }

    /// Drives the motor no more. Eq. 12 finds out with its next step.
    pub(crate) const fn switch_off(&mut self) {
        self.motor.drive(0.0);
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
        self.sampled.as_ref().map_or(self.counter.count_at(end) != count, |plant| !plant.is_at_rest())
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
        self.motor.advance(now);
        self.counter.count(self.seen())
    }

    fn disturb(&mut self, now: Instant, what: &MotorStimulus) {
        self.motor.advance(now);
        match what {
            MotorStimulus::Counts(counts) => self.counter.invent(self.seen(), *counts),
            _ => self.motor.disturb(what, |counts| self.encoder.way(counts)),
        }
    }

    fn restart(&mut self, now: Instant) {
        self.motor.advance(now);
        self.counter.restart(self.seen());
    }

    fn motion(&self) -> Motion {
        match self.sampled {
            None => Motion::of_position(self.motor.clone(), self.encoder, self.along_slide),
            Some(_) => Motion::none(),
        }
    }
}
