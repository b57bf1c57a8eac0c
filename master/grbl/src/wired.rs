//! What the controller's board is wired to.

use torno_grbl::machine::Machine;
use torno_protocol::board::{Deadline, Description, MotorStimulus, Output, Pin};
use torno_protocol::clock::Clock;
use torno_protocol::time::Instant;
use torno_protocol::uart::Receiver;

/// The ports, quantities and events of the board itself come first: those of what it is wired to have the numbers from
/// here on.
pub const PORTS: u8 = 1;
/// The same of quantities.
pub const SIGNALS: u8 = 1;
/// The same of events.
pub const EVENTS: u8 = 3;

/// A machine as it is wired to the controller's board: by a port, or by the board's own pins.
pub trait Wired: Machine + Clone {
    /// Adds what the board has for it: ports, quantities, events, motors, pins.
    fn describe(&self, description: &mut Description);

    /// The receivers of its ports.
    fn receivers(&self) -> Vec<Receiver> {
        Vec::new()
    }

    /// The board restarts: nothing of it knows where the machine is.
    fn restart(&mut self, now: Instant);

    /// The supply is gone, or back. The board restarts as well.
    fn power(&mut self, _now: Instant, _on: bool) {}

    /// The board's oscillator changes.
    fn retune(&mut self, _clock: Clock) {}

    /// A byte has come on one of its ports.
    fn hear(&mut self, _now: Instant, _port: u8, _byte: u8) {}

    /// Something happens to a motor.
    fn disturb(&mut self, _now: Instant, _motor: u8, _what: MotorStimulus) {}

    /// What its quantities are at `at`.
    fn quantities(&self, _at: Instant) -> Vec<(u8, i64)> {
        Vec::new()
    }

    /// Somebody looks at its pins from now on, which is power-on.
    fn watch_pins(&mut self) {}

    /// What the watched pins have done before `until`.
    fn pins(&mut self, _until: Instant) -> Vec<Pin> {
        Vec::new()
    }

    /// Goes on.
    fn step(&mut self, now: Instant);

    /// When [`step`](Self::step) is to be called; `now` is the instant of the last call of anything.
    fn poll_timeout(&self, now: Instant) -> Option<Deadline>;

    /// What the board does for it, at the instant of the last call of anything.
    fn poll_output(&mut self, now: Instant) -> Option<Output>;
}
