//! Plants: what the firmware drives and cannot know but through its encoder.

mod axis;
mod dead;
mod lag;
mod motion;
mod position;
mod rotor;
mod sampled;
mod shaft;
mod speed;

use torno_protocol::board::MotorStimulus;
use torno_protocol::time::Instant;

pub(crate) use axis::Axis;
pub(crate) use dead::DeadTime;
pub(crate) use motion::Motion;
pub(crate) use position::PositionMotor;
pub(crate) use rotor::Rotor;
pub(crate) use sampled::SampledPlant;
pub(crate) use speed::SpeedMotor;

/// A motor with what it moves, the encoder on it, and the count that the firmware has.
pub trait Plant {
    /// Lets the time up to `now` pass with the drive as it is; gives the firmware's count.
    fn advance(&mut self, now: Instant) -> i64;

    /// Something happens to the encoder, the motor or the axis.
    fn disturb(&mut self, now: Instant, what: &MotorStimulus);

    /// The firmware counts from 0 again.
    fn restart(&mut self, now: Instant);

    /// What its encoder sees, for a look at what comes if nothing more happens.
    fn motion(&self) -> Motion;
}
