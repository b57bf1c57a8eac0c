//! What one board's motor and firmware have and the others' have not.

use torno_protocol::board::{Capability, Role, Signal};
use torno_protocol::lathe::Fault;
use torno_protocol::time::Instant;

use crate::pins::Stage;
use crate::plant::Plant;
use crate::schedule::Timing;

/// How many quantities a machine shows in telemetry.
pub(crate) const QUANTITIES: usize = 4;

/// The name of a motor whose board has no other one.
pub(crate) const ONLY_MOTOR: &str = "motor";

/// A control law, and the plant that it drives.
///
/// It does nothing of itself: a [`Task`](crate::Task) calls it, and sees to all that happens to its plant.
pub trait Machine {
    /// Its settings.
    type Settings
    where
        Self: Sized;

    /// The sub-frame that it executes.
    type SubFrame
    where
        Self: Sized;

    /// As at power-on, with when it is sampled.
    fn new(settings: &Self::Settings) -> (Self, Timing)
    where
        Self: Sized;

    /// The quantities, all of motor 0. At power-on each is 0: the firmware counts from where the axis stands.
    fn signals(&self) -> [Signal; QUANTITIES];

    /// The quantities, as the firmware has them.
    fn values(&self) -> [i64; QUANTITIES];

    /// What its motor can do.
    fn capabilities(&self) -> &'static [Capability];

    /// What drives its motor.
    fn stage(&self) -> Stage;

    /// What it drives.
    fn plant(&mut self) -> &mut dyn Plant;

    /// Starts to execute a sub-frame.
    fn start(&mut self, now: Instant, sub_frame: Self::SubFrame)
    where
        Self: Sized;

    /// One sample of the control law. `busy`: a sub-frame is being executed.
    fn sample(&mut self, now: Instant, busy: bool) -> Progress;

    /// The service mode: drives with so many per mille of full drive from now on, whatever the law says. See
    /// [`MotorStimulus::Drive`](torno_protocol::board::MotorStimulus::Drive).
    fn serve(&mut self, per_mille: i32);

    /// The firmware restarts. The plant stays as it is, but for the drive, which is off.
    fn reset(&mut self, now: Instant);

    /// Without a sub-frame or a stimulus, further samples would change nothing.
    fn is_at_rest(&self) -> bool;

    /// A sample may fail although no sub-frame is being executed.
    fn is_on_watch(&self) -> bool {
        false
    }
}

/// A quantity of a board's only motor.
pub(crate) fn quantity(name: &str, role: Role, unit: &str) -> Signal {
    Signal::new(name, 0).with_unit(unit).with_role(role).of_motor(0)
}

/// How far a machine has got with its sub-frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Still at it, or nothing to do.
    Going,
    /// Executed.
    Done,
    /// Failed; the drive is off.
    Failed(Fault),
}
