//! What each node of a running rig costs: for those who want to know what limits it.

use std::time::{Duration, Instant as WallInstant};

use crate::traffic::Bytes;
use torno_engine::{NodeId, Statistics};

/// What one node of a rig has cost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cost {
    /// Its name.
    pub name: String,
    /// Its grants.
    pub statistics: Statistics,
    /// What its grants took over the socket, if it has a process of its own.
    pub bytes: Option<Bytes>,
    /// The wall time for which it was waited for or, without a process of its own, ran. Zero if not
    /// [measured](super::Rig::measure).
    pub wall: Duration,
}

/// Measures which node wall time is spent on.
#[derive(Debug)]
pub(super) struct Stopwatch {
    started: WallInstant,
    lap: WallInstant,
    spent: Vec<Duration>,
}

impl Stopwatch {
    pub(super) fn new(nodes: usize) -> Self {
        let now = wall_now();
        Self { started: now, lap: now, spent: vec![Duration::ZERO; nodes] }
    }

    /// What passes from here on is spent on the node that is [charged](Self::charge) next.
    pub(super) fn lap(&mut self) {
        self.lap = wall_now();
    }

    pub(super) fn charge(&mut self, node: NodeId) {
        let now = wall_now();
        self.spent[node] += now.duration_since(self.lap);
        self.lap = now;
    }

    pub(super) fn spent(&self, node: NodeId) -> Duration {
        self.spent[node]
    }

    pub(super) fn total(&self) -> Duration {
        wall_now().duration_since(self.started)
    }
}

#[expect(clippy::disallowed_methods, reason = "this measures by the wall clock, and moves nothing by it")]
fn wall_now() -> WallInstant {
    WallInstant::now()
}
