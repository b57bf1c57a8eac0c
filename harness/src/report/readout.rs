//! The digital readout of a run: the controller's state, and where the tool is, as the boards tell it.

use std::collections::BTreeMap;

use torno_engine::{Fact, NodeId};
use torno_machines::workpiece::{Part, Source};
use torno_part::Place;

use crate::rig::file::RigFile;

/// A quantity: a board, and a number of its own.
type Quantity = (NodeId, u8);

/// The digital readout of a run.
pub struct Readout {
    /// What the boards have told last.
    told: BTreeMap<Quantity, i64>,
    /// What tells the state of the controller, if there is one that tells it.
    state: Option<Quantity>,
    /// The states' words.
    words: &'static [&'static str],
    /// What moves the tool, and what the program calls the place where it is at the start.
    tool: Option<(Part, Place)>,
}

impl Readout {
    /// A readout of a rig whose controller tells its state as one of these words' numbers, and on which the program
    /// calls the place where the tool is at the start so, or as the rig does.
    pub fn new(file: &RigFile, words: &'static [&'static str], start: Option<Place>) -> Self {
        let mut told = BTreeMap::new();
        let state = file.state().filter(|_| !words.is_empty());
        if let Some((node, signal)) = state {
            told.insert((node, signal), file.boards[node].description.signals[usize::from(signal)].initial);
        }
        let tool = file.part.clone().map(|part| {
            let start = start.unwrap_or_else(|| part.place(0, 0));
            (part, start)
        });
        for Source { node, signals, .. } in tool.iter().flat_map(|(part, _)| [&part.z.way, &part.x.way]) {
            told.extend(signals.iter().map(|signal| ((*node, *signal), 0)));
        }
        Self { told, state, words, tool }
    }

    /// Takes note of what has happened.
    pub fn take(&mut self, facts: &[Fact]) {
        for fact in facts {
            let Fact::Telemetry { node, signal, value, .. } = fact else { continue };
            if let Some(told) = self.told.get_mut(&(*node, *signal)) {
                *told = *value;
            }
        }
    }

    /// The state, and the place in the program's words.
    pub fn text(&self) -> String {
        let value = self.state.and_then(|state| usize::try_from(self.told[&state]).ok());
        let state = value.and_then(|value| self.words.get(value)).map(|word| format!("{word}, "));
        let place = self.tool.as_ref().map(|(part, start)| {
            let gone = |Source { node, signals, per_count }: &Source| {
                per_count * signals.iter().map(|signal| self.told[&(*node, *signal)] as f64).sum::<f64>()
            };
            format!("X {:.3} Z {:.3}, ", start.x + gone(&part.x.way), start.z + gone(&part.z.way))
        });
        state.into_iter().chain(place).collect()
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Instant;

    use super::*;

    const WORDS: &[&str] = &["Idle", "Run"];

    fn told(node: NodeId, signal: u8, value: i64) -> Fact {
        Fact::Telemetry { node, at: Instant::START, signal, value }
    }

    #[test]
    fn it_shows_the_state_and_the_place_that_the_boards_have_told_last() {
        let [grbl, transverse, depth] = [0, 3, 4];
        let file = RigFile::load("lathe-grbl").unwrap();
        let mut readout = Readout::new(&file, WORDS, None);
        assert_eq!(readout.text(), "Idle, X 14.356 Z 0.000, ");
        let position =
            |node: NodeId| file.boards[node].description.signals.iter().position(|it| it.name == "position_counts");
        let [along, across] = [transverse, depth].map(|node| told(node, position(node).unwrap() as u8, -45));
        readout.take(&[told(grbl, 0, 1), along, across, told(1, 0, 7)]);
        assert_eq!(readout.text(), "Run, X 6.356 Z -0.100, ");
        readout.take(&[told(grbl, 0, 9)]);
        assert_eq!(readout.text(), "X 6.356 Z -0.100, ");
    }

    #[test]
    fn a_program_may_call_the_start_something_else_and_a_rig_may_have_neither_state_nor_tool() {
        let start = Some(Place { x: 20.0, z: 5.0 });
        assert_eq!(Readout::new(&RigFile::load("lathe").unwrap(), &[], start).text(), "X 20.000 Z 5.000, ");
        let text = include_str!("../../builtin/lathe.toml").split("[part]").next().unwrap();
        assert_eq!(Readout::new(&RigFile::parse("my.toml", text).unwrap(), &[], None).text(), "");
    }
}
