//! The faults of a running rig: those that are planned, those that have begun, and how they end.

use std::collections::BTreeMap;
use std::fmt;

use torno_protocol::time::Instant;

use super::{Broken, Fault};
use crate::condition::Condition;
use crate::rig::Rig;
use torno_bus::Replies;
use torno_engine::{FaultId, Hit, NodeId, REACTION, WatchId};
use torno_text::nearest;

/// When a fault begins.
#[derive(Clone, Debug)]
pub enum Trigger {
    /// At an instant.
    At(Instant),
    /// [`REACTION`] after something happens.
    When(Condition),
}

/// A fault, and when it begins.
#[derive(Clone, Debug)]
pub struct Planned {
    /// When.
    pub trigger: Trigger,
    /// What.
    pub fault: Fault,
}

/// The faults of a running rig.
///
/// A fault has fired if it has begun; one that lies in wait for a character, if it has met it.
#[derive(Debug, Default)]
pub struct Faults {
    /// Those that wait for something to happen.
    armed: Vec<Armed>,
    /// Those that wait for their instant.
    due: Vec<(Instant, Fault)>,
    /// Those that have begun and are not healed, and some that are over by themselves.
    broken: BTreeMap<String, Broken>,
    /// Those on a line that have not met their character yet.
    waiting: Vec<PendingFault>,
}

/// A fault on a line that waits for its character.
#[derive(Debug)]
struct PendingFault {
    name: String,
    fault: FaultId,
    since: Instant,
    nth: u64,
    line: String,
}

/// A fault that has not fired.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unfired {
    /// Its name.
    pub name: String,
    /// Why it has not.
    pub cause: Cause,
}

/// Why a fault has not fired.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cause {
    /// It has not begun: what it waits for has not happened.
    Unmet(Condition),
    /// It has not begun: all was over before this instant.
    Later(Instant),
    /// It has begun, but its character was not sent.
    Unsent {
        /// Since when it has waited.
        since: Instant,
        /// For which character, counted from then on.
        nth: u64,
        /// On which line.
        line: String,
    },
}

/// A fault that waits for something.
#[derive(Debug)]
struct Armed {
    watch: WatchId,
    condition: Condition,
    /// How often it must still be seen.
    left: u64,
    fault: Fault,
}

/// Why a fault cannot be healed: it has not begun, or is over.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("it has not begun, or is over{nearest}")]
pub struct HealError {
    /// The nearest that there is.
    nearest: String,
}

impl Faults {
    /// Takes a fault that begins by itself, sooner or later; at `now`, at once if what it waits for holds already:
    /// `value` says what each quantity of each board is then. Says since when, if it has begun.
    pub fn plan(
        &mut self,
        rig: &mut Rig,
        planned: &Planned,
        now: Instant,
        value: impl Fn(NodeId, u8) -> i64,
    ) -> Option<Instant> {
        let Planned { trigger, fault } = planned;
        match trigger {
            Trigger::At(at) if *at > now => self.due.push((*at, fault.clone())),
            Trigger::When(condition) if !condition.holds(value) => {
                let watch = rig.watch(condition.watch(rig.pc()));
                let (condition, left) = (condition.clone(), condition.occurrences());
                self.armed.push(Armed { watch, condition, left, fault: fault.clone() });
            }
            Trigger::At(_) | Trigger::When(_) => return Some(self.begin(rig, fault, now)),
        }
        None
    }

    /// Begins a fault at `at`, or as soon after it as nothing settled is touched. Says when.
    pub fn begin(&mut self, rig: &mut Rig, fault: &Fault, at: Instant) -> Instant {
        let broken = fault.begin(rig, at);
        let since = broken.since;
        if let Some((lies_in_wait, (line, nth))) = broken.line.zip(fault.awaited()) {
            let line = rig.layout().lines[line].name.clone();
            self.waiting.push(PendingFault { name: fault.name.clone(), fault: lies_in_wait, since, nth, line });
        }
        if let Some(mut before) = self.broken.insert(fault.name.clone(), broken).filter(|b| b.ends().is_some()) {
            // Its end has come just now.
            before.go_on(rig);
        }
        since
    }

    /// Begins the fault that has waited for what a watch has seen. Says which, and when.
    pub fn see(&mut self, rig: &mut Rig, hit: Hit, replies: &Replies) -> Option<(String, Instant)> {
        let place = self.armed.iter().position(|armed| armed.watch == hit.watch)?;
        let armed = &mut self.armed[place];
        if !armed.condition.is_met(replies, hit.at) {
            return None;
        }
        armed.left -= 1;
        if armed.left > 0 {
            return None;
        }
        let Armed { watch, fault, .. } = self.armed.remove(place);
        rig.unwatch(watch);
        let since = self.begin(rig, &fault, hit.at + REACTION);
        Some((fault.name, since))
    }

    /// Sees to it that a fault that has not begun will not. Says whether there was one.
    pub fn disarm(&mut self, rig: &mut Rig, name: &str) -> bool {
        let waiting = self.armed.len() + self.due.len();
        for armed in self.armed.extract_if(.., |armed| armed.fault.name == name) {
            rig.unwatch(armed.watch);
        }
        self.due.retain(|(_, fault)| fault.name != name);
        self.armed.len() + self.due.len() < waiting
    }

    /// Ends a fault that lasts, at `at` or as soon after it as nothing settled is touched. Says when.
    ///
    /// # Errors
    /// There is none of that name: it has not begun, or is over.
    pub fn heal(&mut self, rig: &mut Rig, name: &str, at: Instant) -> Result<Instant, HealError> {
        self.note_fired(rig);
        let lasting: Vec<&str> =
            self.broken.iter().filter(|(_, broken)| broken.until > at).map(|(name, _)| name.as_str()).collect();
        let healed = if lasting.contains(&name) { None } else { Some(nearest(name, &lasting)) };
        match healed {
            Some(nearest) => Err(HealError { nearest }),
            None => Ok(self.broken.remove(name).map_or(at, |broken| {
                let at = at.max(broken.since);
                broken.heal(rig, at)
            })),
        }
    }

    /// The faults that last at `at`, and those that are still to begin: since when and until when, as far as that is
    /// known.
    pub fn active(
        &mut self,
        rig: &mut Rig,
        at: Instant,
    ) -> impl Iterator<Item = (&str, Option<Instant>, Option<Instant>)> {
        self.note_fired(rig);
        let ends = |until: Instant| (!until.is_never()).then_some(until);
        let broken = self.broken.iter().filter(move |(_, broken)| broken.until > at);
        let broken = broken.map(move |(name, broken)| (name.as_str(), Some(broken.since), ends(broken.until)));
        let due = self.due.iter().map(|(at, fault)| (fault.name.as_str(), Some(*at), None));
        broken.chain(due).chain(self.armed.iter().map(|armed| (armed.fault.name.as_str(), None, None)))
    }

    /// When [`Faults::go_on`] is due: a fault begins, gets worse or ends.
    pub fn next(&self) -> Option<Instant> {
        self.broken.values().filter_map(Broken::next).chain(self.due.iter().map(|(at, _)| *at)).min()
    }

    /// The same without those that only get worse: who waits until all is over waits for the others, too.
    pub fn next_turn(&self) -> Option<Instant> {
        self.broken.values().filter_map(Broken::ends).chain(self.due.iter().map(|(at, _)| *at)).min()
    }

    /// Lets faults begin, get worse and end that are due before or at `now`, once everything before that has happened.
    /// Says which have begun, and when.
    pub fn go_on(&mut self, rig: &mut Rig, now: Instant) -> Vec<(String, Instant)> {
        let going = self.broken.values_mut().filter(|broken| broken.next().is_some_and(|next| next <= now));
        going.for_each(|broken| broken.go_on(rig));
        let due: Vec<(Instant, Fault)> = self.due.extract_if(.., |(at, _)| *at <= now).collect();
        due.into_iter().map(|(at, fault)| (fault.name.clone(), self.begin(rig, &fault, at))).collect()
    }

    /// The faults that have not fired, but for those that have been [disarmed](Self::disarm).
    pub fn unfired(&mut self, rig: &mut Rig) -> Vec<Unfired> {
        self.note_fired(rig);
        let unfired = |name: &String, cause| Unfired { name: name.clone(), cause };
        let armed = self.armed.iter();
        let armed = armed.map(|armed| unfired(&armed.fault.name, Cause::Unmet(armed.condition.clone())));
        let due = self.due.iter().map(|(at, fault)| unfired(&fault.name, Cause::Later(*at)));
        let waiting = self.waiting.iter().map(|PendingFault { name, since, nth, line, .. }| {
            unfired(name, Cause::Unsent { since: *since, nth: *nth, line: line.clone() })
        });
        armed.chain(due).chain(waiting).collect()
    }

    /// Those that have met their character are over.
    fn note_fired(&mut self, rig: &mut Rig) {
        let fired = rig.take_fired();
        self.waiting.retain(|waiting| !fired.contains(&waiting.fault));
        self.broken.retain(|_, broken| broken.line.is_none_or(|fault| !fired.contains(&fault)));
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unmet(condition) => write!(f, "it has not begun: its condition was never met ({condition})"),
            Self::Later(at) => write!(f, "it has not begun: all was over before {at}"),
            Self::Unsent { since, nth, line } => {
                write!(f, "it began at {since}, but character {nth} from then on was never sent on {line}")
            }
        }
    }
}

impl fmt::Display for Unfired {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the fault '{}' has not fired: {}", self.name, self.cause)
    }
}
