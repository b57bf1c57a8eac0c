//! The kinds of receivers, as a board that has them can be described.

use serde::{Deserialize, Serialize};

use crate::clock::Rate;

/// What kind of receiver a port has: with the board's clock, all that makes another one like it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ReceiverKind {
    /// [`Receiver::hardware`](crate::uart::Receiver::hardware).
    Hardware {
        /// Bits per second.
        baud: Rate,
    },
    /// One link of the board's only [`TickTimer`](crate::uart::TickTimer), which has run since the rig started.
    Software {
        /// Bits per second.
        baud: Rate,
        /// Which of the timer's links.
        link: u32,
    },
}

impl ReceiverKind {
    /// Whether characters are received by hardware while the firmware does not run.
    pub const fn is_buffered(self) -> bool {
        matches!(self, Self::Hardware { .. })
    }

    /// Bits per second.
    pub const fn baud(self) -> Rate {
        match self {
            Self::Hardware { baud } | Self::Software { baud, .. } => baud,
        }
    }
}
