//! A line that is being done, and what it waits for.

use torno_protocol::time::Instant;

use crate::block::Block;

/// A line that is being done.
#[derive(Clone, Debug)]
pub(crate) struct Execution {
    pub(crate) block: Block,
    /// The step that has begun and waits for something.
    pub(crate) waits: Option<Wait>,
    /// What is said when it is done.
    pub(crate) answer: Answer,
}

/// What a step waits for, once the machine stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wait {
    Until(Instant),
    /// For the end of a motion towards the probe.
    Probe {
        no_error: bool,
    },
    /// For `~`.
    Resume,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    Ok,
    /// `$Nx=`: it is stored if it is good.
    Stored {
        number: usize,
        block: String,
    },
    /// As a startup line.
    Startup {
        block: String,
    },
}
