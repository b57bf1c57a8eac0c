//! What becomes of boards' processes.

use std::process::ExitStatus;

use torno_protocol::time::Instant;

/// What has become of a board's process.
#[derive(Clone, Debug)]
pub struct Incident {
    /// When, in virtual time.
    pub at: Instant,
    /// The board's name.
    pub board: String,
    /// Its process; 0 if it has joined from where its number is not visible.
    pub pid: u32,
    /// What happened to it.
    pub what: ProcessChange,
}

impl std::fmt::Display for Incident {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "board '{}' (pid {}) ", self.board, self.pid)?;
        match self.what {
            ProcessChange::Stopped => f.write_str("was stopped: it hangs"),
            ProcessChange::Continued => f.write_str("was continued"),
            ProcessChange::Died(Some(status)) => write!(f, "died: {status}"),
            ProcessChange::Died(None) => f.write_str("died: its socket has ended"),
        }
    }
}

/// What has become of a board's process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessChange {
    /// It was stopped.
    Stopped,
    /// It was continued.
    Continued,
    /// It died; how, if the harness had started it.
    Died(Option<ExitStatus>),
}
