//! Why a controller is not proposed.

use torno_identify::Finding;

use crate::session::SessionError;

/// Why there is no proposal.
#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    /// The motor is switched, not regulated.
    #[error("board '{board}' is switched on and off: there is nothing to tune")]
    OnOff {
        /// The board.
        board: String,
    },
    /// P, PI, PD and PID are for a position.
    #[error("--compare is for an axis, whose position a PID regulates: the speed of this motor has a lead compensator")]
    NoAxis,
    /// Nothing can rehearse a controller.
    #[error(
        "there is no board that could rehearse this controller: --code needs a motor of a rig, for its test vectors"
    )]
    NoRehearsal,
    /// There is no such controller.
    #[error(transparent)]
    Finding(#[from] Finding),
    /// The board does not take it.
    #[error("board '{board}' does not take what is proposed: {message}")]
    Settings {
        /// The board.
        board: String,
        /// Why.
        message: String,
    },
    /// The rig broke.
    #[error(transparent)]
    Session(#[from] SessionError),
}
