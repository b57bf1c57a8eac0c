//! Whoever looks on while a rig runs by itself, and lets the faults begin that wait for something.

use torno_protocol::board::Description;
use torno_protocol::time::Instant;

use super::{Faults, Planned};
use crate::rig::Rig;
use torno_bus::{Dialect, PcEvent, Replies};
use torno_engine::Fact;

/// So many replies are remembered for the faults that wait for one.
const REPLIES: usize = 16;

/// What the PC has heard lately: faults may begin with a reply.
#[derive(Debug)]
pub struct Onlooker {
    replies: Replies,
}

fn initial(description: &Description) -> Vec<i64> {
    description.signals.iter().map(|signal| signal.initial).collect()
}

/// What has come of looking.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Looked {
    /// Something has been seen: time may go on.
    pub seen: bool,
    /// The faults that have begun by that, and when.
    pub begun: Vec<(String, Instant)>,
}

impl Onlooker {
    /// One who has heard nothing yet of this dialect.
    pub fn new(dialect: &dyn Dialect) -> Self {
        Self { replies: Replies::new(dialect) }
    }

    /// Takes the faults that begin by themselves, for a rig that does not run yet. Says which have begun at once.
    pub fn plan(&self, rig: &mut Rig, faults: &mut Faults, planned: &[Planned]) -> Vec<(String, Instant)> {
        let initial: Vec<Vec<i64>> = rig.nodes().iter().map(|node| initial(&node.description)).collect();
        let value = |node: usize, signal: u8| initial[node][usize::from(signal)];
        let begin = |planned: &Planned| {
            let since = faults.plan(rig, planned, Instant::START, value)?;
            Some((planned.fault.name.clone(), since))
        };
        planned.iter().filter_map(begin).collect()
    }

    /// Takes note of what has happened, and begins what has waited for it.
    pub fn look(&mut self, rig: &mut Rig, faults: &mut Faults, facts: &[Fact]) -> Looked {
        for fact in facts {
            if let Fact::Event { node, at, event, value } = fact
                && *node == rig.pc()
            {
                match PcEvent::from_numbers(*event, *value) {
                    Some(PcEvent::Sent(byte)) => drop(self.replies.send(*at, byte)),
                    Some(PcEvent::Received(byte)) => drop(self.replies.hear(*at, byte)),
                    Some(PcEvent::Garbled(_)) | None => {}
                }
            }
        }
        let mut looked = Looked::default();
        for hit in rig.take_hits() {
            looked.seen = true;
            looked.begun.extend(faults.see(rig, hit, &self.replies));
        }
        self.replies.keep_last(REPLIES);
        looked
    }
}
