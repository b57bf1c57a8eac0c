//! When a board can next change the level of a port.

use torno_protocol::time::Instant;

/// What a board's state says of the next edge on one of its ports, but for what it may yet hear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sending {
    /// What it has told, or has promised if it hears nothing more.
    pub(super) told: Instant,
    /// A new character waits for the end of the one on the line.
    pub(super) free: Instant,
    /// A cut does not.
    pub(super) cut: Instant,
}

impl Sending {
    /// Nothing comes, whatever the board hears.
    pub(super) const NOTHING: Self = Self { told: Instant::NEVER, free: Instant::NEVER, cut: Instant::NEVER };

    /// The earliest output time (EOT): the earliest instant at which the port can change in a way that has not been
    /// settled, if nothing unheard can matter to the board before `eit`.
    pub(super) fn earliest_edge(&self, eit: Instant) -> Instant {
        self.told.min(eit).max(self.free).min(self.cut)
    }
}
