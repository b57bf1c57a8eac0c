//! The last value of every quantity.

use std::collections::BTreeMap;

use torno_engine::{Fact, NodeId};
use torno_protocol::time::Instant;

use crate::rig::Rig;
use crate::rig::file::RigFile;
use crate::speed::AxisSpeed;

/// The last value of every quantity of every board.
pub struct Telemetry {
    nodes: Vec<Vec<(String, i64)>>,
    speeds: Vec<AxisSpeed>,
    /// Everything before this has been noted.
    settled: Instant,
}

impl Telemetry {
    /// The quantities of `rig`, at their initial values.
    pub fn new(rig: &Rig) -> Self {
        let signals = rig.nodes().iter().map(|node| &node.description.signals);
        let nodes = signals.map(|signals| signals.iter().map(|s| (s.name.clone(), s.initial)).collect()).collect();
        Self { nodes, speeds: Vec::new(), settled: Instant::START }
    }

    /// The same with the speeds of the axes, which no board tells.
    #[must_use]
    pub fn with_speeds(self, file: &RigFile) -> Self {
        Self { speeds: AxisSpeed::of(file), ..self }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        if let Fact::Telemetry { node, signal, value, .. } = fact
            && let Some((_, last)) = self.nodes[*node].get_mut(usize::from(*signal))
        {
            *last = *value;
            self.speeds.iter_mut().for_each(|speed| _ = speed.note(fact));
        }
    }

    /// Everything before `settled` has been noted.
    pub const fn settle(&mut self, settled: Instant) {
        self.settled = settled;
    }

    /// The value of a board's quantity.
    pub fn value(&self, node: NodeId, signal: u8) -> i64 {
        self.nodes[node].get(usize::from(signal)).map_or(0, |(_, value)| *value)
    }

    /// The values of a board's quantities, in the order of its description.
    pub fn values(&self, node: NodeId) -> Vec<i64> {
        self.nodes[node].iter().map(|(_, value)| *value).collect()
    }

    /// The quantities of a board, and the speeds of its axes.
    pub fn of(&self, node: NodeId) -> BTreeMap<String, i64> {
        let speeds = self.speeds.iter().filter(|speed| speed.node == node);
        let speeds = speeds.map(|speed| (speed.signal.name.clone(), speed.at(self.settled)));
        self.nodes[node].iter().cloned().chain(speeds).collect()
    }
}
