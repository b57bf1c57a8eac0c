//! What came into a rig from outside: with the rig file, all that a run depends on.

use serde::{Deserialize, Serialize};
use torno_protocol::board::Stimulus;
use torno_protocol::time::Instant;

use crate::{Disturbance, LineId, NodeId};

/// Something that came into the rig from outside.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// How far anything had been settled when it came. Nothing settled by then depends on it.
    pub given: Instant,
    /// From when on it holds.
    pub at: Instant,
    /// What it was.
    pub what: InputKind,
}

/// What can come into a rig from outside. In traces these are numbered in this order: new ones go to the end.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InputKind {
    /// A board, or the PC's UART, got a stimulus.
    Stimulus {
        /// The board.
        board: NodeId,
        /// What.
        stimulus: Stimulus,
    },
    /// A fault on a line began.
    Disturbed {
        /// The line.
        line: LineId,
        /// The fault's number, by which it is healed.
        fault: u32,
        /// What.
        disturbance: Disturbance,
    },
    /// A fault on a line ended.
    Healed {
        /// The line.
        line: LineId,
        /// The fault's number.
        fault: u32,
    },
    /// A board's process was stopped: the board hangs.
    Stopped {
        /// The board.
        board: NodeId,
        /// The end of what it had told. Unless it is continued, nothing of this instant and later comes from it.
        told: Instant,
    },
    /// A board's process was continued.
    Continued {
        /// The board.
        board: NodeId,
    },
    /// A board's process died.
    Died {
        /// The board.
        board: NodeId,
        /// The end of what it had told: nothing of this instant and later comes from it.
        told: Instant,
    },
}
