//! A wire: what its sender drives, what is done to it on the way, and what its receiver sees.
//!
//! A sound wire hands each character on as it is committed. A disturbed one hands on what is sure: what its sender, a
//! fault or the wire it is shorted to can no longer change.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use torno_protocol::line::{Edge, Level, Waveform};
use torno_protocol::time::{Instant, Span};

use super::{End, FaultId, LineId};

/// Noise is made this far ahead at the most.
const NOISE_AHEAD: Span = Span::from_millis(10);

/// What can be done to a wire. In traces these are numbered in this order: new ones go to the end.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Disturbance {
    /// It is cut: the receiver's pull-up keeps its end idle.
    Cut,
    /// It is connected to a rail.
    Stuck(Level),
    /// It touches another wire: both are low if either is driven low.
    Short(LineId),
    /// Pulses that invert it come at random.
    Noise {
        /// The mean time from one pulse to the next.
        period: Span,
        /// The longest pulse; the shortest is next to nothing.
        width: Span,
        /// What the pulses are drawn from.
        seed: u64,
    },
    /// Something happens to one character: the `nth` of those that are committed from when the fault begins on, from 1.
    /// Of several that meet the same one, that which began first acts first; of those that began together, that which
    /// was asked for first. What happens to it is decided when it is committed; it ends when the fault is healed.
    Character {
        /// Which.
        nth: u64,
        /// What.
        what: Tampering,
    },
}

/// What can happen to one character on its way. Numbered as the disturbances are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Tampering {
    /// A bit is inverted: 0 is the start bit, 1 to 8 the data bits, least significant first, 9 the stop bit.
    Flip(u8),
    /// An edge comes late: the sender drives it late, for the wires that this one touches too. 0 is the first edge of
    /// the character; beyond its last, the last.
    Delay {
        /// Which edge.
        edge: u8,
        /// How much later.
        by: Span,
    },
    /// It does not get through.
    Drop,
    /// It is followed by its own echo.
    Double,
}

/// While it lasts, a level is changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Force {
    fault: FaultId,
    from: Instant,
    until: Instant,
    how: How,
}

/// In the order in which they apply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum How {
    Invert,
    Low,
    High,
}

#[derive(Clone, Debug)]
struct Noise {
    fault: FaultId,
    until: Instant,
    random: ChaCha8Rng,
    period: Span,
    width: Span,
    /// The start of the next pulse.
    next: Instant,
}

#[derive(Clone, Debug)]
struct Trap {
    fault: FaultId,
    from: Instant,
    until: Instant,
    /// Characters still to come, this one included.
    left: u64,
    what: Tampering,
}

#[derive(Clone, Copy, Debug)]
struct Contact {
    fault: FaultId,
    other: LineId,
    from: Instant,
    until: Instant,
}

/// What the receiver is to be told of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Passed {
    /// These edges.
    Edges(Vec<Edge>),
    /// The line goes idle; edges from then on that it was told of will not come.
    Cut(Instant),
}

/// What a sender drives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Driven {
    level: Level,
    next: Instant,
    /// Its own wire has handed on everything before this instant.
    passed: Instant,
}

/// One wire.
#[derive(Debug)]
pub(super) struct Wire {
    pub(super) from: End,
    pub(super) to: End,
    /// What the sender drives, from a little before `passed` on.
    driven: Waveform,
    forces: Vec<Force>,
    noises: Vec<Noise>,
    traps: Vec<Trap>,
    contacts: Vec<Contact>,
    /// If it is disturbed: everything before this instant has been handed on.
    passed: Option<Instant>,
    /// What the receiver has been told last.
    told: Edge,
    /// What the receiver has been told and may still be withdrawn.
    unsure: Vec<Edge>,
    /// The level before that.
    sure: Level,
    /// What can no longer be withdrawn lies before this instant.
    taken: Instant,
    /// Where it was disturbed last: what was driven before this has been handed on, or has not got through.
    sound_from: Instant,
    /// Faults that have met their character, since they were asked for.
    fired: Vec<FaultId>,
    /// The last instant at which something happened to it while it was disturbed, if only a fault that ended.
    happened: Instant,
}

impl Noise {
    /// From one pulse to the next: as long as it is by chance (exponentially distributed).
    fn gap(&mut self) -> Span {
        let chance = (1 + (self.random.next_u64() >> 11)) as f64 / (1u64 << 53) as f64;
        Span::from_nanos(1 + (self.period.as_nanos() as f64 * -libm::log(chance)) as u64)
    }
}

impl Wire {
    pub(super) fn new(from: End, to: End) -> Self {
        Self {
            from,
            to,
            driven: Waveform::idle(),
            forces: Vec::new(),
            noises: Vec::new(),
            traps: Vec::new(),
            contacts: Vec::new(),
            passed: None,
            told: Edge { at: Instant::START, level: Level::High },
            unsure: Vec::new(),
            sure: Level::High,
            taken: Instant::START,
            sound_from: Instant::START,
            fired: Vec::new(),
            happened: Instant::START,
        }
    }

    pub(super) fn is_disturbed(&self) -> bool {
        self.passed.is_some()
    }

    /// Whether all that its receiver has been told has been [taken](Self::take_sure).
    pub(super) const fn is_sure(&self) -> bool {
        self.unsure.is_empty()
    }

    /// Whether it touches other wires, now or later.
    pub(super) const fn touches_others(&self) -> bool {
        !self.contacts.is_empty()
    }

    /// The other wires that it touches, now or later.
    pub(super) fn contacts(&self) -> impl Iterator<Item = LineId> {
        self.contacts.iter().map(|contact| contact.other)
    }

    /// A character is committed at `at`. Gives what its receiver hears of it at once.
    pub(super) fn carry(&mut self, at: Instant, edges: Vec<Edge>, end: Instant) -> Option<Vec<Edge>> {
        let edges = self.tamper(at, edges, end);
        self.driven.extend(&edges);
        if self.is_disturbed() || edges.is_empty() {
            return None;
        }
        self.tell(&edges);
        // Of the characters before nothing is needed any more.
        self.driven.forget_before(edges[0].at);
        Some(edges)
    }

    fn tell(&mut self, edges: &[Edge]) {
        self.told = edges.last().copied().unwrap_or(self.told);
        self.unsure.extend_from_slice(edges);
    }

    /// The sender goes idle at `at`: edges from then on are not driven after all.
    pub(super) fn withdraw(&mut self, at: Instant) -> Option<Passed> {
        self.driven.cut(at);
        if self.is_disturbed() { None } else { self.take_back(at) }
    }

    /// The receiver must forget what it has been told of the time from `at` on.
    fn take_back(&mut self, at: Instant) -> Option<Passed> {
        self.unsure.retain(|edge| edge.at < at);
        (self.told.at >= at).then(|| {
            self.told = Edge { at, level: Level::High };
            if self.unsure.last().map_or(self.sure, |edge| edge.level) == Level::Low {
                self.unsure.push(self.told);
            }
            Passed::Cut(at)
        })
    }

    /// Takes what can no longer be withdrawn: everything before `sure`, as far as it has been handed on.
    pub(super) fn take_sure(&mut self, sure: Instant) -> Vec<Edge> {
        let sure = self.passed.map_or(sure, |passed| passed.min(sure));
        let n = self.unsure.partition_point(|edge| edge.at < sure);
        let taken: Vec<Edge> = self.unsure.drain(..n).collect();
        if let Some(last) = taken.last() {
            self.sure = last.level;
            self.taken = last.at.next();
        }
        taken
    }

    /// Begins a fault that lasts from `at` until it is healed; nothing settled lies at or after `now`. Gives what its
    /// receiver must be told at once.
    pub(super) fn disturb(&mut self, fault: FaultId, now: Instant, at: Instant, what: &Disturbance) -> Option<Passed> {
        let passed = self.begin(now);
        let until = Instant::NEVER;
        let force = |how| Force { fault, from: at, until, how };
        match *what {
            Disturbance::Cut => self.force(force(How::High)),
            Disturbance::Stuck(Level::Low) => self.force(force(How::Low)),
            Disturbance::Stuck(Level::High) => self.force(force(How::High)),
            Disturbance::Short(other) => self.contacts.push(Contact { fault, other, from: at, until }),
            Disturbance::Noise { period, width, seed } => {
                let mut noise =
                    Noise { fault, until, random: ChaCha8Rng::seed_from_u64(seed), period, width, next: at };
                noise.next = at + noise.gap();
                self.noises.push(noise);
            }
            Disturbance::Character { nth, what } => {
                // Of several that meet one character, the one that began first acts first, whenever they were asked
                // for.
                let place = self.traps.partition_point(|other| other.from <= at);
                self.traps.insert(place, Trap { fault, from: at, until, left: nth.max(1), what });
            }
        }
        passed
    }

    /// From now on only what is sure is handed on, and what was told of the time from `now` on is taken back.
    fn begin(&mut self, now: Instant) -> Option<Passed> {
        match self.passed {
            Some(_) => None,
            None => {
                self.passed = Some(self.told.at.max(self.sound_from).min(now));
                self.take_back(now)
            }
        }
    }

    fn force(&mut self, force: Force) {
        let place = self.forces.partition_point(|other| other.how <= force.how);
        self.forces.insert(place, force);
    }

    /// Ends a fault at `at`.
    pub(super) fn heal(&mut self, fault: FaultId, at: Instant) {
        let end = |other: FaultId, until: &mut Instant| {
            if other == fault {
                *until = at.min(*until);
            }
        };
        self.forces.iter_mut().for_each(|force| end(force.fault, &mut force.until));
        self.noises.iter_mut().for_each(|noise| end(noise.fault, &mut noise.until));
        self.traps.iter_mut().for_each(|trap| end(trap.fault, &mut trap.until));
        self.contacts.iter_mut().for_each(|contact| end(contact.fault, &mut contact.until));
    }

    /// Which faults have met their character since the last call.
    pub(super) fn take_fired(&mut self) -> Vec<FaultId> {
        core::mem::take(&mut self.fired)
    }

    /// Lets the traps that are set for a character act on it.
    fn tamper(&mut self, at: Instant, mut edges: Vec<Edge>, end: Instant) -> Vec<Edge> {
        let Some(first) = edges.first().map(|edge| edge.at) else { return edges };
        let mut forces = Vec::new();
        for trap in self.traps.iter_mut().filter(|trap| trap.from <= at && at < trap.until && trap.left > 0) {
            trap.left -= 1;
            if trap.left > 0 {
                continue;
            }
            self.fired.push(trap.fault);
            let mut force = |from, until: Instant, how| {
                // Healed ahead of time, it ends as if it were healed then.
                forces.push(Force { fault: trap.fault, from, until: until.min(trap.until), how });
            };
            let length = end.since(first);
            match trap.what {
                Tampering::Flip(bit) => {
                    let edge = |bit: u64| first + Span::from_nanos(length.as_nanos() * bit / 10);
                    let bit = u64::from(bit.min(9));
                    force(edge(bit), edge(bit + 1), How::Invert);
                }
                Tampering::Drop => force(first, end, How::High),
                Tampering::Double => {
                    let lows = edges.chunk_by(|a, _| a.level == Level::Low);
                    lows.filter(|low| low[0].level == Level::Low).for_each(|low| {
                        let until = low.get(1).map_or(end, |edge| edge.at);
                        force(low[0].at + length, until + length, How::Low);
                    });
                }
                Tampering::Delay { edge, by } => {
                    // Another delay can have left it without edges.
                    let Some(last) = edges.len().checked_sub(1) else { continue };
                    let edge = usize::from(edge).min(last);
                    // The next character's begin where this one ends.
                    edges[edge].at = (edges[edge].at + by).min(end);
                    // An edge that comes after the next one has no effect, nor has the next.
                    if edges.get(edge + 1).is_some_and(|next| next.at <= edges[edge].at) {
                        edges.drain(edge..edge + 2);
                    }
                }
            }
        }
        forces.into_iter().for_each(|force| self.force(force));
        edges
    }

    /// Whether it is noisy, now or later.
    pub(super) const fn is_noisy(&self) -> bool {
        !self.noises.is_empty()
    }

    /// How far noise lets this wire be handed on: noise comes as the receiver goes, or as time does if there is none.
    pub(super) fn noise_until(&self, receiver: Option<Instant>) -> Instant {
        if self.is_noisy() { receiver.unwrap_or(self.settled()) + NOISE_AHEAD } else { Instant::NEVER }
    }

    /// The first instant at which the level can change and that has not been handed on, as far as it is known.
    pub(super) fn next_change(&self, driven: impl Fn(LineId, Instant) -> Driven) -> Instant {
        let Some(passed) = self.passed else { return Instant::NEVER };
        let noises = self.noises.iter().filter(|noise| noise.next < noise.until).map(|noise| noise.next);
        noises.chain([self.next_from(passed, driven)]).min().unwrap_or(Instant::NEVER)
    }

    /// Hands on everything before `sure`, if it is disturbed; every character that is committed before `committed` has
    /// been carried; `driven` says what drives another wire. Gives the edges, if that is news.
    pub(super) fn pass(
        &mut self,
        sure: Instant,
        committed: Instant,
        driven: impl Fn(LineId, Instant) -> Driven,
    ) -> Option<Vec<Edge>> {
        let passed = self.passed.filter(|passed| *passed < sure)?;
        self.make_noise(sure);
        let mut edges = Vec::new();
        let (mut at, mut reached) = (passed, passed);
        while at < sure {
            let level = self.level(at, &driven);
            let level_changes = level != self.told.level;
            if level_changes {
                self.told = Edge { at, level };
                edges.push(self.told);
            }
            if level_changes || self.next_from(at, &driven) == at {
                reached = at.next();
                self.happened = at;
            }
            at = self.next_from(at.next(), &driven);
        }
        // If nothing more is known to come, something may still come from outside the rig.
        let reached = if sure.is_never() { reached } else { sure };
        if self.contacts.is_empty() {
            self.driven.forget_before(passed);
        }
        // What was taken back at an instant, and comes again at once, has not changed.
        let same = self.unsure.pop_if(|last| edges.first().is_some_and(|first| first.at == last.at)).is_some();
        self.unsure.extend_from_slice(&edges[usize::from(same)..]);
        self.passed = Some(reached);
        self.forget(reached, committed, driven);
        (reached > passed || !self.is_disturbed()).then_some(edges)
    }

    fn make_noise(&mut self, until: Instant) {
        let mut pulses = Vec::new();
        for noise in &mut self.noises {
            while noise.next < until.min(noise.until) {
                let width = Span::from_nanos(1 + noise.random.next_u64() % noise.width.as_nanos().max(1));
                let end = (noise.next + width).min(noise.until);
                pulses.push(Force { fault: noise.fault, from: noise.next, until: end, how: How::Invert });
                noise.next = end + noise.gap();
            }
        }
        pulses.into_iter().for_each(|pulse| self.force(pulse));
    }

    fn level(&self, at: Instant, driven: impl Fn(LineId, Instant) -> Driven) -> Level {
        let mut level = self.driven.level_at(at);
        for contact in self.contacts.iter().filter(|contact| contact.from <= at && at < contact.until) {
            if driven(contact.other, at).level == Level::Low {
                level = Level::Low;
            }
        }
        for force in self.forces.iter().filter(|force| force.from <= at && at < force.until) {
            level = match (force.how, level) {
                (How::Invert, Level::High) | (How::Low, _) => Level::Low,
                (How::Invert, Level::Low) | (How::High, _) => Level::High,
            };
        }
        level
    }

    /// The first instant from `at` on at which the level can change.
    fn next_from(&self, at: Instant, driven: impl Fn(LineId, Instant) -> Driven) -> Instant {
        let forces = self.forces.iter().flat_map(|force| [force.from, force.until]);
        let contacts = self.contacts.iter().flat_map(|contact| [contact.from, contact.until]);
        let others = self.contacts.iter().filter_map(|contact| {
            let next = driven(contact.other, at.max(contact.from)).next;
            (next < contact.until).then_some(next)
        });
        let known = forces.chain(contacts).filter(|change| *change >= at);
        known.chain(others).chain([self.driven(at).next]).min().unwrap_or(Instant::NEVER)
    }

    /// Forgets what lies before `passed`; a wire that is sound again hands characters on as they come.
    fn forget(&mut self, passed: Instant, committed: Instant, driven: impl Fn(LineId, Instant) -> Driven) {
        // What ends at `passed` has not ended for the receiver yet.
        self.forces.retain(|force| force.until >= passed);
        self.noises.retain(|noise| noise.until >= passed);
        // A character that is committed before `passed` can have all its edges after it.
        self.traps.retain(|trap| trap.left > 0 && trap.until > passed.min(committed));
        // The other wire still looks at what this one drives until it has handed on as much.
        self.contacts.retain(|contact| contact.until >= passed.min(driven(contact.other, passed).passed));
        let sound = self.forces.is_empty()
            && self.noises.is_empty()
            && self.traps.is_empty()
            && self.contacts.is_empty()
            && self.driven.falling_from(passed).or(self.driven.rising_from(passed)).is_none();
        if sound {
            self.sound_from = passed;
            self.passed = None;
        }
    }

    /// The last instant at which something happens on it, as far as it has been handed on.
    pub(super) fn last_change(&self) -> Instant {
        self.told.at.max(self.happened)
    }

    /// Before this instant nothing of it changes any more, however far its sender is settled.
    pub(super) fn settled(&self) -> Instant {
        self.passed.unwrap_or(self.sound_from).max(self.taken)
    }

    /// What the sender drives at `at`, and its first change from then on.
    pub(super) fn driven(&self, at: Instant) -> Driven {
        let next = [self.driven.falling_from(at), self.driven.rising_from(at)].into_iter().flatten().min();
        let passed = self.passed.unwrap_or(Instant::NEVER);
        Driven { level: self.driven.level_at(at), next: next.unwrap_or(Instant::NEVER), passed }
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::clock::{Clock, Rate};
    use torno_protocol::uart::{Character, Receiver, Transmitter};

    use super::*;

    const BAUD: Rate = Rate::hz(9600);
    const FAULT: FaultId = FaultId(1);

    fn us(us: u64) -> Instant {
        Instant::START + Span::from_micros(us)
    }

    /// A wire with a sender that sends a byte every 2 ms, from 1 ms on, and what its receiver makes of it.
    struct Bench {
        wire: Wire,
        sender: Transmitter,
        receiver: Receiver,
        next: Instant,
    }

    impl Bench {
        fn new() -> Self {
            let end = End { node: 0, port: 0 };
            let sender = Transmitter::hardware(BAUD, Clock::TRUE);
            let receiver = Receiver::hardware(BAUD, Clock::TRUE);
            Self { wire: Wire::new(end, end), sender, receiver, next: us(1_000) }
        }

        fn disturb(&mut self, at: Instant, what: Disturbance) {
            let told = self.wire.disturb(FAULT, at, at, &what);
            self.tell(told);
        }

        fn tell(&mut self, passed: Option<Passed>) {
            match passed {
                Some(Passed::Edges(edges)) => self.receiver.hear(&edges),
                Some(Passed::Cut(at)) => self.receiver.hear_cut(at),
                None => {}
            }
        }

        fn send(&mut self, bytes: &[u8]) {
            for byte in bytes {
                self.sender.push(*byte);
                let loaded = self.sender.load(self.next).unwrap();
                let told = self.wire.carry(self.next, loaded.edges, loaded.end).map(Passed::Edges);
                self.tell(told);
                self.next += Span::from_millis(2);
            }
        }

        /// Sends, and gives what is received of it.
        fn received(&mut self, bytes: &[u8]) -> Vec<Character> {
            self.send(bytes);
            let passed = self.wire.pass(self.next, self.next, idle).map(Passed::Edges);
            self.tell(passed);
            let next = |receiver: &mut Receiver| receiver.poll_timeout().and_then(|at| receiver.take(at));
            core::iter::from_fn(|| next(&mut self.receiver)).collect()
        }
    }

    /// Of any other wire.
    fn idle(_: LineId, _: Instant) -> Driven {
        Driven { level: Level::High, next: Instant::NEVER, passed: Instant::NEVER }
    }

    fn good(bytes: &[u8]) -> Vec<Character> {
        bytes.iter().map(|byte| Character::good(*byte)).collect()
    }

    fn tampered(nth: u64, what: Tampering, bytes: &[u8]) -> Vec<Character> {
        let mut bench = Bench::new();
        bench.disturb(us(0), Disturbance::Character { nth, what });
        let received = bench.received(bytes);
        assert_eq!(bench.wire.take_fired(), if nth as usize <= bytes.len() { vec![FAULT] } else { vec![] });
        received
    }

    #[test]
    fn a_sound_wire_hands_on_what_it_carries() {
        let mut bench = Bench::new();
        assert_eq!(bench.received(b"abc"), good(b"abc"));
        assert!(!bench.wire.is_disturbed());
    }

    #[test]
    fn one_character_can_be_damaged() {
        assert_eq!(tampered(2, Tampering::Flip(1), b"abc"), good(b"acc"));
        assert!(tampered(2, Tampering::Flip(9), b"abc")[1].framing_error);
        assert_eq!(tampered(3, Tampering::Drop, b"abc"), good(b"ab"));
        assert_eq!(tampered(1, Tampering::Double, b"a"), good(b"aa"));
        let late = Tampering::Delay { edge: 0, by: Span::from_micros(30) };
        assert_eq!(tampered(1, late, b"\x55"), good(b"\x55"), "three tenths of a bit late is early enough");
        let very_late = Tampering::Delay { edge: 1, by: Span::from_micros(80) };
        assert_eq!(tampered(1, very_late, b"\x55"), good(b"\x54"));
        assert_eq!(tampered(4, Tampering::Drop, b"abc"), good(b"abc"));
    }

    #[test]
    fn a_character_that_a_delay_has_left_nothing_of_can_be_delayed_again() {
        let mut bench = Bench::new();
        let by = Span::from_micros(200);
        let delay = Disturbance::Character { nth: 1, what: Tampering::Delay { edge: 0, by } };
        bench.disturb(us(0), delay.clone());
        bench.disturb(us(0), delay);
        assert_eq!(bench.received(b"\xffa"), good(b"a"));
        assert_eq!(bench.wire.take_fired(), [FAULT, FAULT]);
    }

    #[test]
    fn of_several_that_meet_a_character_the_one_that_began_first_acts_first() {
        let received = |early: Span, late: Span| {
            let mut bench = Bench::new();
            let delay = |edge, by| Disturbance::Character { nth: 1, what: Tampering::Delay { edge, by } };
            for (from, what) in [(us(20), delay(0, late)), (us(10), delay(1, early))] {
                let told = bench.wire.disturb(FAULT, us(0), from, &what);
                bench.tell(told);
            }
            bench.received(b"\xff")
        };
        // An edge that would have been passed has gone on before.
        assert_eq!(received(Span::from_micros(200), Span::from_micros(200)), good(b"\xff"));
        assert_eq!(received(Span::from_micros(1), Span::from_micros(200)), []);
    }

    #[test]
    fn what_happens_to_a_character_ends_with_its_fault_whenever_that_was_healed() {
        let edges = |healed_before: bool| {
            let mut bench = Bench::new();
            bench.disturb(us(0), Disturbance::Character { nth: 1, what: Tampering::Drop });
            if healed_before {
                bench.wire.heal(FAULT, us(1_500));
            }
            bench.send(b"U");
            bench.wire.heal(FAULT, us(1_500));
            bench.wire.pass(us(5_000), us(5_000), idle)
        };
        assert_eq!(edges(true), edges(false));
        assert!(edges(true).is_some_and(|edges| edges.len() > 2));
    }

    #[test]
    fn an_echo_follows_its_character_and_meets_what_comes_then() {
        let mut bench = Bench::new();
        bench.disturb(us(0), Disturbance::Character { nth: 1, what: Tampering::Double });
        bench.send(b"a");
        bench.next += Span::from_millis(8);
        assert_eq!(bench.received(b"b"), good(b"aab"));
    }

    #[test]
    fn a_cut_withdraws_what_the_receiver_was_told_and_a_healed_wire_is_sound() {
        let mut bench = Bench::new();
        bench.send(b"U");
        // In mid-character.
        bench.disturb(us(1_400), Disturbance::Cut);
        assert_eq!(bench.received(b"abc").len(), 1, "the beginning of the first");
        bench.wire.heal(FAULT, bench.next);
        assert_eq!(bench.received(b"def"), good(b"def"));
        assert!(!bench.wire.is_disturbed());
        assert_eq!(bench.received(b"g"), good(b"g"));
    }

    #[test]
    fn a_fault_that_changes_nothing_leaves_nothing_behind() {
        let edges = |disturb: bool| {
            let mut bench = Bench::new();
            bench.send(b"a");
            if disturb {
                // While the wire is low.
                bench.disturb(us(1_300), Disturbance::Character { nth: 9, what: Tampering::Drop });
            }
            assert_eq!(bench.received(b"b"), good(b"ab"));
            bench.wire.take_sure(bench.next)
        };
        assert_eq!(edges(true), edges(false));
    }

    #[test]
    fn a_fault_that_ends_where_the_wire_has_been_handed_on_to_still_ends() {
        let mut bench = Bench::new();
        bench.disturb(us(0), Disturbance::Character { nth: 1, what: Tampering::Flip(9) });
        bench.sender.push(b'a');
        let loaded = bench.sender.load(us(1_000)).unwrap();
        assert_eq!(bench.wire.carry(us(1_000), loaded.edges, loaded.end), None);
        assert!(bench.wire.pass(loaded.end, loaded.end, idle).is_some());
        assert_eq!(
            bench.wire.pass(us(5_000), us(5_000), idle),
            Some(vec![Edge { at: loaded.end, level: Level::High }])
        );
        assert!(!bench.wire.is_disturbed());
    }

    #[test]
    fn a_fault_meets_a_character_committed_before_its_end_whose_edges_come_after_it() {
        let mut bench = Bench::new();
        bench.disturb(us(0), Disturbance::Character { nth: 1, what: Tampering::Drop });
        bench.wire.heal(FAULT, us(1_000));
        // The sender has promised that no edge comes before 1 ms, and has told of what it did until 0.9 ms.
        bench.wire.pass(us(1_000), us(900), idle);
        bench.next = us(950);
        bench.send(b"a");
        assert_eq!(bench.wire.take_fired(), vec![FAULT]);
    }

    #[test]
    fn what_can_no_longer_be_withdrawn_is_settled() {
        let mut bench = Bench::new();
        bench.send(b"a");
        let last = bench.wire.take_sure(Instant::NEVER).last().unwrap().at;
        assert_eq!(bench.wire.settled(), last.next());
    }

    #[test]
    fn a_wire_stuck_low_is_one_break_and_one_stuck_high_is_silent() {
        let mut bench = Bench::new();
        bench.disturb(us(0), Disturbance::Stuck(Level::Low));
        let received = bench.received(b"abc");
        assert!(received.len() == 1 && received[0].framing_error && received[0].byte == 0, "{received:?}");
        let mut bench = Bench::new();
        bench.disturb(us(0), Disturbance::Stuck(Level::High));
        assert_eq!(bench.received(b"abc"), []);
    }

    #[test]
    fn a_short_pulls_the_wire_low_while_the_other_is_driven_low() {
        let mut bench = Bench::new();
        bench.disturb(us(0), Disturbance::Short(7));
        bench.send(b"\xff");
        // The other wire is low during the first four data bits.
        let (from, to) = (us(1_104), us(1_520));
        let other = |line: LineId, at: Instant| {
            assert_eq!(line, 7);
            let level = if at >= from && at < to { Level::Low } else { Level::High };
            let next = [from, to].into_iter().find(|edge| *edge >= at).unwrap_or(Instant::NEVER);
            Driven { level, next, passed: Instant::NEVER }
        };
        let edges = bench.wire.pass(us(5_000), us(5_000), other).unwrap();
        bench.receiver.hear(&edges);
        let at = bench.receiver.poll_timeout().unwrap();
        assert_eq!(bench.receiver.take(at), Some(Character::good(0xf0)));
    }

    #[test]
    fn noise_is_the_seeds_and_no_other() {
        let noisy = |seed| {
            let mut bench = Bench::new();
            let (period, width) = (Span::from_micros(300), Span::from_micros(100));
            bench.disturb(us(0), Disturbance::Noise { period, width, seed });
            bench.received(&[0x55; 50])
        };
        assert_eq!(noisy(1), noisy(1));
        assert_ne!(noisy(1), noisy(2));
        assert!(noisy(1) != good(&[0x55; 50]));
    }
}
