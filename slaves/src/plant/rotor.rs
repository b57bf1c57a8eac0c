//! A motor that turns for ever, as its firmware sees it: with an encoder on its shaft.

use torno_protocol::board::{Capability, MotorStimulus};
use torno_protocol::time::Instant;

use crate::encoder::{Counter, Encoder};
use crate::plant::{DeadTime, Motion, Plant, SpeedMotor};

/// A motor with its encoder, and the count of it that the firmware has.
#[derive(Clone, Debug)]
pub(crate) struct Rotor {
    motor: SpeedMotor,
    dead: DeadTime,
    encoder: Encoder,
    counter: Counter,
    /// What full drive is at the motor, in V.
    supply_v: f64,
}

impl Rotor {
    pub(crate) const CAPABILITIES: &[Capability] = &[Capability::Motor];

    /// `dead_ms` is the dead time between drive and motor.
    pub(crate) fn new(motor: SpeedMotor, encoder: Encoder, supply_v: f64, dead_ms: f64) -> Self {
        Self { motor, dead: DeadTime::new(dead_ms), encoder, counter: Counter::new(encoder), supply_v }
    }

    /// Drives the motor with this share of full drive from now on, or from when its dead time is over.
    pub(crate) fn drive(&mut self, share: f64) {
        if let Some(share) = self.dead.set(self.motor.at(), share) {
            self.motor.drive(share * self.supply_v);
        }
    }

    /// Lets the time up to `now` pass.
    fn pass(&mut self, now: Instant) {
        while let Some((at, share)) = self.dead.due(now) {
            self.motor.advance(at);
            self.motor.drive(share * self.supply_v);
        }
        self.motor.advance(now);
    }

    /// Whatever the drive, the shaft does not turn.
    pub(crate) fn is_held(&self) -> bool {
        self.motor.is_held()
    }

    /// Not driven, it comes to rest beyond this count.
    pub(crate) fn exceeds(&self, count: i64) -> bool {
        self.dead.is_pending() || self.counter.count_at(self.motor.coast_end_rev()) > count
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
        self.pass(now);
        self.counter.count(self.motor.angle_rev())
    }

    fn disturb(&mut self, now: Instant, what: &MotorStimulus) {
        self.pass(now);
        match what {
            MotorStimulus::Stall(blocked) => self.motor.block(*blocked),
            MotorStimulus::Counts(counts) => self.counter.invent(self.motor.angle_rev(), *counts),
            MotorStimulus::Load(per_mille) => self.motor.set_load(*per_mille),
            MotorStimulus::Supply(per_mille) => self.motor.set_supply(*per_mille),
            _ => {}
        }
    }

    fn restart(&mut self, now: Instant) {
        self.pass(now);
        self.counter.restart(self.motor.angle_rev());
    }

    fn motion(&self) -> Motion {
        let coming = self.dead.under_way().map(|(at, share)| (at, share * self.supply_v));
        Motion::of_speed(self.motor.clone(), self.encoder).with(coming)
    }
}
