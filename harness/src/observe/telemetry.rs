//! The last value of every quantity.

use std::collections::BTreeMap;

use crate::rig::Rig;
use torno_engine::{Fact, NodeId};

/// The last value of every quantity of every board.
pub struct Telemetry {
    nodes: Vec<Vec<(String, i64)>>,
}

impl Telemetry {
    /// The quantities of `rig`, at their initial values.
    pub fn new(rig: &Rig) -> Self {
        let signals = rig.nodes().iter().map(|node| &node.description.signals);
        Self { nodes: signals.map(|signals| signals.iter().map(|s| (s.name.clone(), s.initial)).collect()).collect() }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        if let Fact::Telemetry { node, signal, value, .. } = fact
            && let Some((_, last)) = self.nodes[*node].get_mut(usize::from(*signal))
        {
            *last = *value;
        }
    }

    /// The value of a board's quantity.
    pub fn value(&self, node: NodeId, signal: u8) -> i64 {
        self.nodes[node].get(usize::from(signal)).map_or(0, |(_, value)| *value)
    }

    /// The values of a board's quantities, in the order of its description.
    pub fn values(&self, node: NodeId) -> Vec<i64> {
        self.nodes[node].iter().map(|(_, value)| *value).collect()
    }

    /// The quantities of a board.
    pub fn of(&self, node: NodeId) -> BTreeMap<String, i64> {
        self.nodes[node].iter().cloned().collect()
    }
}
