//! The pins between the boards' firmware and their motors, for a waveform dump.
//!
//! No board reports its pins while a rig runs: a pulse-width modulator alone has 2400 edges a second. Between inputs a
//! board is deterministic, and a trace holds all inputs. So each board runs once more, by itself and in this process,
//! hears what it heard, and has its pins watched.

use torno_engine::{Fact, NodeId};
use torno_machines::kinds::{self, KindError};
use torno_protocol::board::{Output, Pin};
use torno_protocol::record::{Heard, Timed};
use torno_protocol::time::Instant;
use torno_trace::Trace;

use crate::replay::{Action, ReplayError, actions, rig_of};

/// Why the pins are not known.
#[derive(Debug, thiserror::Error)]
pub enum PinsError {
    /// The rig in the trace is none for this version of torno.
    #[error(transparent)]
    Rig(#[from] ReplayError),
    /// A board cannot be built.
    #[error(transparent)]
    Kind(#[from] KindError),
    /// A board does not do again what it did: it is not of this program.
    #[error("the pins of board '{board}' are not known: it did something else than a board of this torno does")]
    Differs {
        /// The board.
        board: String,
    },
}

/// What the pins of all boards did in a trace; each is called after its board, as in `spindle_pwm`.
///
/// # Errors
/// [`PinsError`].
pub fn pins(trace: &Trace) -> Result<Vec<Pin>, PinsError> {
    let (file, _) = rig_of(trace)?;
    let actions = actions(&trace.inputs);
    let mut found = Vec::new();
    for (node, board) in file.boards.iter().enumerate() {
        let (heard, until) = heard(trace, &actions, node);
        let built = kinds::build(&board.kind, &board.settings, board.clock)?;
        let (outputs, pins) = built.watch(&heard, until);
        if !pins.is_empty() && !told(&outputs).eq(recorded(trace, node, until)) {
            return Err(PinsError::Differs { board: board.name.clone() });
        }
        found.extend(pins.into_iter().map(|pin| Pin { name: format!("{}_{}", board.name, pin.name), ..pin }));
    }
    Ok(found)
}

/// All that a board has heard, and until when it ran.
pub(crate) fn heard(trace: &Trace, actions: &[(Instant, Action)], node: NodeId) -> (Vec<Heard>, Instant) {
    let end = actions.iter().find(|(_, action)| *action == Action::End(node));
    let until = end.map_or(trace.until(), |(told, _)| trace.until().min(*told));
    let stimuli = actions.iter().filter_map(|(_, action)| match action {
        Action::Stimulate(to, at, stimulus) if *to == node => {
            Some(Heard::Stimulus { at: *at, stimulus: stimulus.clone() })
        }
        _ => None,
    });
    (edges(trace, node).chain(stimuli).collect(), until)
}

/// The edges on the lines that end at a board.
fn edges(trace: &Trace, node: NodeId) -> impl Iterator<Item = Heard> + '_ {
    let lines = &trace.header.layout.lines;
    trace.facts.iter().filter_map(move |fact| match fact {
        Fact::Edges { line, edges } if lines[*line].to.0 == node => {
            Some(Heard::Edges { port: lines[*line].to.1, edges: edges.clone() })
        }
        _ => None,
    })
}

/// What a board tells besides what goes over its lines: when, whether it is an event, which, and the value.
type Word = (Instant, bool, u8, i64);

fn told(outputs: &[Timed]) -> impl Iterator<Item = Word> {
    outputs.iter().filter_map(|Timed { at, output }| match output {
        Output::Telemetry { signal, value } => Some((*at, false, *signal, *value)),
        Output::Event { event, value } => Some((*at, true, *event, *value)),
        Output::Character { .. } | Output::Cut { .. } | Output::Pin { .. } => None,
    })
}

fn recorded(trace: &Trace, of: NodeId, until: Instant) -> impl Iterator<Item = Word> {
    let words = trace.facts.iter().filter_map(move |fact| match fact {
        Fact::Telemetry { node, at, signal, value } if *node == of => Some((*at, false, *signal, *value)),
        Fact::Event { node, at, event, value } if *node == of => Some((*at, true, *event, *value)),
        _ => None,
    });
    words.filter(move |(at, ..)| *at < until)
}
