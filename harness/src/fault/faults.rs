//! The faults of a running rig: those that are planned, those that have begun, and how they end.

use std::collections::BTreeMap;

use torno_protocol::time::Instant;

use super::{Broken, Fault};
use crate::condition::Condition;
use crate::engine::{FaultId, Hit, REACTION, WatchId};
use crate::pc::Replies;
use crate::rig::Rig;
use crate::text::nearest;

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
#[derive(Debug, Default)]
pub struct Faults {
    armed: Vec<Armed>,
    /// Those that have begun and are not healed, and some that are over by themselves.
    broken: BTreeMap<String, Broken>,
    /// Those that have not broken anything yet; on a line, they may lie in wait for a character.
    unfired: Vec<(String, Option<FaultId>)>,
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

/// Why a fault cannot be healed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HealError {
    /// There is none of that name: it has not begun, or is over.
    #[error("it has not begun, or is over{nearest}")]
    Unknown {
        /// The nearest that there is.
        nearest: String,
    },
    /// Its end is settled.
    #[error("it ends by itself, at {until}")]
    EndsByItself {
        /// When.
        until: Instant,
    },
}

impl Faults {
    /// Takes a fault that begins by itself, sooner or later.
    pub fn plan(&mut self, rig: &mut Rig, planned: &Planned) {
        let Planned { trigger, fault } = planned;
        match trigger {
            Trigger::At(at) => drop(self.begin(rig, fault, *at)),
            Trigger::When(condition) => {
                self.unfired.push((fault.name.clone(), None));
                let watch = rig.watch(condition.watch(rig.pc()));
                let (condition, left) = (condition.clone(), condition.occurrences());
                self.armed.push(Armed { watch, condition, left, fault: fault.clone() });
            }
        }
    }

    /// Begins a fault at `at`, or as soon after it as nothing settled is touched. Says when.
    pub fn begin(&mut self, rig: &mut Rig, fault: &Fault, at: Instant) -> Instant {
        let broken = fault.begin(rig, at);
        let since = broken.since;
        self.unfired.retain(|(name, _)| *name != fault.name);
        if let Some(lies_in_wait) = broken.line.filter(|_| fault.lies_in_wait()) {
            self.unfired.push((fault.name.clone(), Some(lies_in_wait)));
        }
        self.broken.insert(fault.name.clone(), broken);
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
        let Some(place) = self.armed.iter().position(|armed| armed.fault.name == name) else { return false };
        rig.unwatch(self.armed.remove(place).watch);
        self.unfired.retain(|(other, _)| other != name);
        true
    }

    /// Ends a fault that has begun, at `at` or as soon after it as nothing settled is touched. Says when.
    ///
    /// # Errors
    /// [`HealError`].
    pub fn heal(&mut self, rig: &mut Rig, name: &str, at: Instant) -> Result<Instant, HealError> {
        match self.broken.get(name) {
            Some(Broken { until, .. }) if !until.is_never() && *until > at => {
                return Err(HealError::EndsByItself { until: *until });
            }
            Some(Broken { until, .. }) if until.is_never() => {}
            _ => {
                let known: Vec<&str> = self.active(at).map(|(name, ..)| name).collect();
                return Err(HealError::Unknown { nearest: nearest(name, &known) });
            }
        }
        // One that is still to begin ends when it does.
        Ok(self.broken.remove(name).map_or(at, |broken| {
            let at = at.max(broken.since);
            broken.heal(rig, at)
        }))
    }

    /// The faults that last at `at`, and those that are still to begin: since when and until when, as far as that is
    /// known.
    pub fn active(&self, at: Instant) -> impl Iterator<Item = (&str, Option<Instant>, Option<Instant>)> {
        let ends = |until: Instant| (!until.is_never()).then_some(until);
        let broken = self.broken.iter().filter(move |(_, broken)| broken.until > at);
        let broken = broken.map(move |(name, broken)| (name.as_str(), Some(broken.since), ends(broken.until)));
        broken.chain(self.armed.iter().map(|armed| (armed.fault.name.as_str(), None, None)))
    }

    /// When [`Faults::go_on`] is due, if a fault gets worse with time.
    pub fn next(&self) -> Option<Instant> {
        self.broken.values().filter_map(Broken::next).min()
    }

    /// Lets faults get worse that are due before or at `now`, once everything before that has happened.
    pub fn go_on(&mut self, rig: &mut Rig, now: Instant) {
        let due = self.broken.values_mut().filter(|broken| broken.next().is_some_and(|next| next <= now));
        due.for_each(|broken| broken.go_on(rig));
    }

    /// The faults that have broken nothing.
    pub fn unfired(&mut self, rig: &mut Rig) -> Vec<String> {
        let fired = rig.take_fired();
        self.unfired.retain(|(_, lies_in_wait)| lies_in_wait.is_none_or(|fault| !fired.contains(&fault)));
        self.unfired.iter().map(|(name, _)| name.clone()).collect()
    }
}
