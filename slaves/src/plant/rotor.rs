//! A motor that turns for ever, as its firmware sees it: with an encoder on its shaft.

use torno_protocol::board::{Capability, MotorStimulus};
use torno_protocol::time::Instant;

use crate::encoder::{Counter, Encoder};
use crate::plant::{Motion, Plant, SpeedMotor};

/// A motor with its encoder, and the count of it that the firmware has.
#[derive(Clone, Debug)]
pub(crate) struct Rotor {
    motor: SpeedMotor,
    encoder: Encoder,
    counter: Counter,
    /// What full drive is at the motor, in V.
    supply_v: f64,
}

impl Rotor {
    pub(crate) const CAPABILITIES: &[Capability] = &[Capability::Motor];

    pub(crate) const fn new(motor: SpeedMotor, encoder: Encoder, supply_v: f64) -> Self {
        Self { motor, encoder, counter: Counter::new(encoder), supply_v }
    }

    /// Drives the motor with this share of full drive from now on.
    pub(crate) fn drive(&mut self, share: f64) {
        self.motor.drive(share * self.supply_v);
    }

    /// Whatever the drive, the shaft does not turn.
    pub(crate) fn is_held(&self) -> bool {
        self.motor.is_held()
    }

    /// Not driven, it comes to rest beyond this count.
    pub(crate) fn exceeds(&self, count: i64) -> bool {
        self.counter.count_at(self.motor.coast_end_rev()) > count
    }

    /// Its true speed at `now` if it is driven as it is.
    #[cfg(test)]
    pub(crate) fn rpm_at(&self, now: Instant) -> f64 {
        let mut motor = self.motor.clone();
        motor.advance(now);
        motor.rpm()
    }
}

impl Plant for Rotor {
    fn advance(&mut self, now: Instant) -> i64 {
        self.motor.advance(now);
        self.counter.count(self.motor.angle_rev())
    }

    fn disturb(&mut self, now: Instant, what: &MotorStimulus) {
        self.motor.advance(now);
        match what {
            MotorStimulus::Stall(blocked) => self.motor.block(*blocked),
            MotorStimulus::Counts(counts) => self.counter.invent(self.motor.angle_rev(), *counts),
            MotorStimulus::Load(per_mille) => self.motor.set_load(*per_mille),
            MotorStimulus::Supply(per_mille) => self.motor.set_supply(*per_mille),
            _ => {}
        }
    }

    fn restart(&mut self, now: Instant) {
        self.motor.advance(now);
        self.counter.restart(self.motor.angle_rev());
    }

    fn motion(&self) -> Motion {
        Motion::of_speed(self.motor.clone(), self.encoder)
    }
}
