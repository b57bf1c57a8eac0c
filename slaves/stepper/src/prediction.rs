//! What the machine will do if nothing more happens: reckoned once, however often it is asked for.
//!
//! A rotor that swings costs time for each substep. The loop has to know when it will find an error, so the machine is
//! run ahead, and its states on the way are kept: whoever asks for a place later begins at the last one of them.
//! Whoever runs a board also goes back to a checkpoint whenever a character arrives, and does the same again. So the
//! last predictions are kept too, in common with all copies of the axis. (All of this concerns the cost only: the same
//! comes out without it.)

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use torno_protocol::time::{Instant, Span};

use crate::machine::{Machine, Stretch};
use crate::watch::Watch;

/// So many predictions are kept, of those that took more substeps than that.
const KEPT: usize = 32;
const SUBSTEPS_KEPT: u32 = 16;
/// While the rotor swings, a state is kept so often.
const STATE_EVERY: Span = Span::from_millis(2);
/// A rotor that swings without a train is looked ahead for so many substeps: a second.
const SUBSTEPS_MAX: u32 = 10_000;

/// What the machine will do, as far as it has been looked ahead.
#[derive(Clone, Debug)]
pub(crate) struct Prediction {
    /// What has been looked for is found then.
    pub(crate) found: Option<Instant>,
    /// Until then it has not been found; the rotor may swing on from then on.
    pub(crate) again: Option<Instant>,
    /// The machine on the way, in order.
    states: Vec<Machine>,
    substeps: u32,
}

impl Prediction {
    /// Looks ahead for the first instant that `looked_for` finds, if nothing more happens: until the trains are over,
    /// and without one for [`SUBSTEPS_MAX`].
    pub(crate) fn new(from: &Machine, mut looked_for: impl FnMut(&Machine, &Stretch<'_>) -> Option<Instant>) -> Self {
        let mut machine = from.clone();
        let mut prediction = Self { found: None, again: None, states: Vec::new(), substeps: 0 };
        let end = machine.end().unwrap_or(Instant::NEVER);
        let mut is_first = true;
        while machine.at < end {
            let swings = is_first || machine.plant.swings();
            let until = if swings { end.min(machine.at + STATE_EVERY) } else { end };
            is_first = false;
            let Self { found, again, substeps, .. } = &mut prediction;
            let stopped = machine.walk(until, |machine, stretch| {
                *found = looked_for(machine, stretch);
                *substeps += u32::from(stretch.path.is_some());
                *again =
                    (found.is_none() && end == Instant::NEVER && *substeps > SUBSTEPS_MAX).then(|| stretch.times().1);
                found.or(*again)
            });
            if stopped.is_some() {
                return prediction;
            }
            prediction.states.push(machine.clone());
        }
        // A train that follows at once comes first.
        prediction.again = (end < Instant::NEVER).then(|| end.next());
        prediction
    }

    /// The last state that is kept of the time from `from` up to `until`.
    pub(crate) fn state(&self, from: Instant, until: Instant) -> Option<&Machine> {
        let after = self.states.partition_point(|machine| machine.at <= until);
        self.states[..after].last().filter(|machine| machine.at > from)
    }
}

/// A prediction, with the machine and the watch that it is for.
type Kept = (Machine, Option<Watch>, Arc<Prediction>);

/// The last predictions for a rotor that swings.
#[derive(Clone, Debug, Default)]
pub(crate) struct Predictions(Arc<Mutex<VecDeque<Kept>>>);

impl Predictions {
    /// When the watch finds an error, if nothing more happens; without one, only what the machine does.
    pub(crate) fn of(&self, from: &Machine, watch: Option<Watch>) -> Arc<Prediction> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((.., known)) = kept.iter().find(|(machine, other, _)| machine == from && *other == watch) {
            return Arc::clone(known);
        }
        let prediction = Arc::new(Prediction::new(from, |machine, stretch| watch?.first(machine, stretch)));
        if prediction.substeps > SUBSTEPS_KEPT {
            kept.truncate(KEPT - 1);
            kept.push_front((from.clone(), watch, Arc::clone(&prediction)));
        }
        prediction
    }
}
