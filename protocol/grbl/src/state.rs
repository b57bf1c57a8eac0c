//! What the firmware is doing.

/// As a status names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Nothing moves.
    Idle,
    /// The cycle runs.
    Run,
    /// Held, or about to be.
    Hold,
    /// A jog runs.
    Jog,
    /// `$H`
    Home,
    /// Locked until `$X`, `$H` or a reset.
    Alarm,
    /// G-code is only read.
    Check,
    /// The door is open, or was.
    Door,
    /// Until a reset.
    Sleep,
}
