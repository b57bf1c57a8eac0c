//! The time engine: decides how far each board may run, and turns what boards report into facts.
//!
//! The engine is the hub of the rig: every line runs through it. It is conservative between boards: nothing that it
//! has made a fact is ever taken back. Boards run ahead on their own and say what they will do if nothing reaches them
//! (see [`torno_protocol::stepping`]); the engine makes a fact of what no unheard edge can change any more.
//!
//! For a board *a* and its port *p*:
//! - `EOT(a, p)`, its earliest output time: the earliest instant at which a new edge can appear on the port: the first
//!   one that the board has told, or the end of what it has told, or the first instant at which something unheard can
//!   matter to it, whichever is least; but not before the end of the character that is on the line.
//! - `EIT(b)`, the earliest input time of board *b*: the earliest instant at which something unheard can matter to it.
//!   It is the least, over the lines that end at it, of what its receiver makes of an edge at `EOT`
//!   ([`Ear::effect`](torno_protocol::uart::Ear::effect)): about 9.5 bit times later.
//!
//! The two are iterated from infinity; every line adds a lookahead above zero, so there is always progress. Bounds are
//! exclusive.
//!
//! What an idle board or line costs is nothing: the engine keeps lists of what has changed, what is disturbed, what can
//! be settled and who needs a grant, and looks at these only.

mod bounds;
mod input;
mod node;
mod places;
mod sending;
mod wire;

use std::collections::BTreeSet;

use torno_protocol::board::{Output, PinOutput, Stimulus};
use torno_protocol::line::Edge;
use torno_protocol::record::{Grant, Heard, Report, Silence, Timed};
use torno_protocol::time::{Instant, Span};

use bounds::{Agenda, Reach};
use node::Node;
use places::Places;
use wire::{Passed, Wire};

pub use input::{Input, InputKind};
pub use node::Life;
pub use wire::{Disturbance, Tampering};

/// Boards that are needed within this span of one another are woken together.
const TOGETHER: Span = Span::from_micros(900);

/// Whoever watches can act so long after what was seen. (Ours: shorter would cut time into more grants.)
pub const REACTION: Span = Span::from_millis(1);

/// A board's place in the rig.
pub type NodeId = usize;
/// A line's place in the rig.
pub type LineId = usize;

/// One end of a line: a board and the number of its port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// The board.
    pub node: NodeId,
    /// The port's number on that board.
    pub port: u8,
}

/// A fault on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FaultId(u32);

impl FaultId {
    /// Its number: no other fault of this engine has it.
    pub const fn number(self) -> u32 {
        self.0
    }
}

/// A watch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WatchId(u32);

/// What to look out for among what a board tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watch {
    /// The board.
    pub node: NodeId,
    /// What it tells.
    pub what: Sight,
}

/// What can be looked out for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// An event, whatever its value.
    Event(u8),
    /// A character that is committed to a port.
    Character(u8),
    /// A quantity that reaches a value from `least` to `most`, or changes within them.
    Telemetry {
        /// The quantity's number.
        signal: u8,
        /// The least value that counts.
        least: i64,
        /// The greatest.
        most: i64,
    },
}

impl Watch {
    /// Whether this is what is looked out for.
    pub(crate) fn sees(&self, output: &Output) -> bool {
        match (self.what, output) {
            (Sight::Event(event), Output::Event { event: told, .. }) => event == *told,
            (Sight::Character(port), Output::Character { port: sent, .. }) => port == *sent,
            (Sight::Telemetry { signal, least, most }, Output::Telemetry { signal: told, value }) => {
                signal == *told && (least..=most).contains(value)
            }
            _ => false,
        }
    }
}

/// Something that a watch has seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hit {
    /// Which.
    pub watch: WatchId,
    /// When.
    pub at: Instant,
}

/// Something that has happened and will stay so.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fact {
    /// A line carries these edges.
    Edges {
        /// The line.
        line: LineId,
        /// Its edges, in order.
        edges: Vec<Edge>,
    },
    /// A quantity of a board has changed.
    Telemetry {
        /// The board.
        node: NodeId,
        /// When.
        at: Instant,
        /// The signal's number.
        signal: u8,
        /// Its new value.
        value: i64,
    },
    /// Something happened on a board.
    Event {
        /// The board.
        node: NodeId,
        /// When.
        at: Instant,
        /// The event's number.
        event: u8,
        /// Its value.
        value: i64,
    },
    /// An output pin of a board does something.
    Pin {
        /// The board.
        node: NodeId,
        /// When it is told.
        at: Instant,
        /// The pin's number.
        pin: u8,
        /// What.
        what: PinOutput,
    },
}

impl Fact {
    /// When it happened, or the first of its edges.
    pub fn at(&self) -> Instant {
        match self {
            Self::Edges { edges, .. } => edges.first().map_or(Instant::START, |edge| edge.at),
            Self::Telemetry { at, .. } | Self::Event { at, .. } | Self::Pin { at, .. } => *at,
        }
    }

    /// When it happened, or the last of its edges.
    pub fn last(&self) -> Instant {
        match self {
            Self::Edges { edges, .. } => edges.last().map_or(Instant::START, |edge| edge.at),
            Self::Telemetry { at, .. } | Self::Event { at, .. } | Self::Pin { at, .. } => *at,
        }
    }
}

/// A board told something that it had promised not to do: a defect in the board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("board number {node} told of something at {at}, but everything before {commit} had been settled")]
pub struct LateOutput {
    node: NodeId,
    at: Instant,
    commit: Instant,
}

/// How far time may go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// Nothing at or after this instant is settled.
    pub until: Instant,
    /// No board concludes anything from the silence of the world outside at or after this instant.
    pub silence: Instant,
}

impl Limit {
    /// As far as there is something to do.
    pub const NONE: Self = Self { until: Instant::NEVER, silence: Instant::NEVER };

    /// Up to `until`.
    pub const fn until(until: Instant) -> Self {
        Self { until, silence: Instant::NEVER }
    }

    /// The same, but no further than `until`, if that is said.
    pub fn earlier(self, until: Option<Instant>) -> Self {
        Self { until: until.map_or(self.until, |until| until.min(self.until)), ..self }
    }
}

/// What a board has cost, for those who want to know what limits a rig. Without a pace, the same on every machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Grants given to it.
    pub grants: u64,
    /// Those of them that took back something it had told: it had run ahead of what it then heard.
    pub redone: u64,
}

/// The time engine of one rig.
#[derive(Debug, Default)]
pub struct Engine {
    nodes: Vec<Node>,
    lines: Vec<Wire>,
    /// What each line adds to its receiver's `EIT`.
    reaches: Vec<Reach>,
    /// Boards that have changed since [`Engine::bound`] last looked.
    changed: Places,
    agenda: Agenda,
    /// Lines that are disturbed.
    disturbed: Places,
    /// Boards of which not all may have been settled that is safe.
    unsettled: Places,
    /// Lines of which not all may have been reported that their receivers have been told.
    unsure: Places,
    /// Boards that need a grant if time is to go past an instant.
    needs: BTreeSet<(Instant, NodeId)>,
    /// How many boards are yet to answer.
    waiting: usize,
    frontier: Instant,
    watches: Vec<(WatchId, Watch)>,
    hits: Vec<Hit>,
    fired: Vec<FaultId>,
    /// Faults and watches so far.
    issued: u32,
    facts: Vec<Fact>,
    /// How often a line's part in a bound has been computed.
    #[cfg(test)]
    computed: u64,
}

impl Engine {
    /// An engine without boards.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a board with so many ports.
    pub fn add_node(&mut self, ports: usize) -> NodeId {
        let id = self.nodes.len();
        self.nodes.push(Node::new(ports));
        self.note_change(id);
        id
    }

    /// Adds a line from one board's port to another's. A port sends to one line at the most.
    pub fn add_line(&mut self, from: End, to: End) -> LineId {
        let line = self.lines.len();
        self.lines.push(Wire::new(from, to));
        self.reaches.push(Reach::NONE);
        self.nodes[from.node].sends_to[usize::from(from.port)] = Some(line);
        self.nodes[to.node].hears.push((usize::from(to.port), line));
        self.agenda.look_at(line);
        line
    }

    /// Begins a fault on a line, at `at` or the [frontier](Self::frontier), whichever is later. It lasts until it is
    /// [healed](Self::heal). Says when it begins.
    pub fn disturb(&mut self, line: LineId, at: Instant, what: &Disturbance) -> (FaultId, Instant) {
        let now = self.frontier();
        let at = at.max(now);
        let fault = FaultId(self.issue());
        self.disturb_one(line, fault, now, at, what);
        if let Disturbance::Short(other) = *what {
            self.disturb_one(other, fault, now, at, &Disturbance::Short(line));
        }
        (fault, at)
    }

    fn disturb_one(&mut self, line: LineId, fault: FaultId, now: Instant, at: Instant, what: &Disturbance) {
        let passed = self.lines[line].disturb(fault, now, at, what);
        self.disturbed.insert(line);
        if let Some(passed) = passed {
            self.tell(line, passed);
        }
    }

    /// Ends a fault on a line, at `at` or the [frontier](Self::frontier), whichever is later. Says when.
    pub fn heal(&mut self, fault: FaultId, at: Instant) -> Instant {
        let at = at.max(self.frontier());
        self.lines.iter_mut().for_each(|line| line.heal(fault, at));
        at
    }

    /// Faults that lay in wait for a character and have met it, since the last call.
    pub fn take_fired(&mut self) -> Vec<FaultId> {
        core::mem::take(&mut self.fired)
    }

    /// Watches what a board tells. Until the watch is [removed](Self::unwatch), nothing is settled that lies
    /// [`REACTION`] or more after a hit that has not been [taken](Self::take_hits): whoever watches can act then.
    pub fn watch(&mut self, watch: Watch) -> WatchId {
        let id = WatchId(self.issue());
        self.watches.push((id, watch));
        self.note_watched(watch.node);
        id
    }

    /// Ends a watch.
    pub fn unwatch(&mut self, id: WatchId) {
        let Some(place) = self.watches.iter().position(|(other, _)| *other == id) else { return };
        let (_, watch) = self.watches.remove(place);
        self.hits.retain(|hit| hit.watch != id);
        self.note_watched(watch.node);
    }

    fn note_watched(&mut self, node: NodeId) {
        self.nodes[node].watched = self.watches.iter().any(|(_, watch)| watch.node == node);
        self.note_change(node);
    }

    /// Whether no one watches and no line is disturbed: then how far time goes at once is of no interest to anybody.
    pub fn is_undisturbed(&self) -> bool {
        self.watches.is_empty() && self.disturbed.iter().next().is_none()
    }

    /// What watches have seen since the last call, in the order of its instants.
    pub fn take_hits(&mut self) -> Vec<Hit> {
        let mut hits = core::mem::take(&mut self.hits);
        hits.sort_by_key(|hit| (hit.at, hit.watch));
        hits
    }

    fn issue(&mut self) -> u32 {
        self.issued += 1;
        self.issued
    }

    /// Gives a board a stimulus, at `at` or the [frontier](Self::frontier), whichever is later; says when.
    pub fn stimulate(&mut self, node: NodeId, at: Instant, stimulus: Stimulus) -> Instant {
        let at = at.max(self.frontier());
        self.hear(node, Heard::Stimulus { at, stimulus });
        at
    }

    /// The least instant that nothing settled depends on: what comes from outside can be dated from here on.
    pub const fn frontier(&self) -> Instant {
        self.frontier
    }

    /// What has been settled since the last call, each line's and each board's facts in order.
    pub fn take_facts(&mut self) -> Vec<Fact> {
        core::mem::take(&mut self.facts)
    }

    /// Takes back the memory of facts that no one needs any more.
    pub fn reuse(&mut self, mut facts: Vec<Fact>) {
        if self.facts.capacity() == 0 {
            facts.clear();
            self.facts = facts;
        }
    }

    /// What a board has cost.
    pub fn statistics(&self, node: NodeId) -> Statistics {
        self.nodes[node].statistics
    }

    /// Settles everything within `limit` that can be settled, and says which boards must take a grant for more.
    /// Each must be answered by [`Engine::answer`].
    pub fn poll(&mut self, limit: Limit) -> Vec<(NodeId, Grant)> {
        let until = loop {
            self.bound();
            let until = self.held_at(limit).min(self.reaction());
            let mut moved = self.pass(until);
            let mut next = 0;
            while let Some(id) = self.unsettled.first_from(next) {
                next = id + 1;
                let (safe, before) = (self.nodes[id].safe_until(), self.nodes[id].commit);
                moved |= self.settle(id, safe.min(until));
                moved |= self.nodes[id].commit > before && self.hears_noise(id);
                if safe <= until {
                    self.unsettled.remove(id);
                }
            }
            if !moved {
                break until;
            }
        };
        self.settle_lines(until);
        self.wake(until)
    }

    /// Takes a board's answer to its grant.
    ///
    /// # Errors
    /// [`LateOutput`] if the board reports something that came too late.
    pub fn answer(&mut self, node: NodeId, report: Report) -> Result<(), LateOutput> {
        let commit = self.nodes[node].commit;
        // Telemetry of a mute board comes when the board is woken, however late that is.
        let on_port = |told: &&Timed| matches!(told.output, Output::Character { .. } | Output::Cut { .. });
        match report.outputs.iter().find(on_port) {
            Some(Timed { at, .. }) if *at < commit => Err(LateOutput { node, at: *at, commit }),
            _ => {
                self.nodes[node].answer(report);
                self.note_change(node);
                Ok(())
            }
        }
    }

    /// Grants that bring every board towards `until`, mute or not: one that has much to tell needs several. For the
    /// start, and for when the rig is [quiet](Self::is_quiet).
    pub fn catch_up(&mut self, until: Instant) -> Vec<(NodeId, Grant)> {
        let behind: Vec<NodeId> = (0..self.nodes.len()).filter(|id| self.nodes[*id].is_behind(until)).collect();
        behind.into_iter().map(|id| (id, self.grant(id, until))).collect()
    }

    /// Whether a board that runs has not come to `until`.
    pub fn is_behind(&self, until: Instant) -> bool {
        self.nodes.iter().any(|node| node.is_behind(until))
    }

    fn grant(&mut self, id: NodeId, until: Instant) -> Grant {
        let grant = self.nodes[id].grant(until);
        self.note_change(id);
        grant
    }

    /// Takes note that a board has changed in any way: with the next [bound](Self::bound), all that rests on it is
    /// looked at again.
    fn note_change(&mut self, id: NodeId) {
        let node = &mut self.nodes[id];
        let waits = node.awaited && node.life == Life::Runs;
        if waits != core::mem::replace(&mut node.counted, waits) {
            self.waiting = if waits { self.waiting + 1 } else { self.waiting - 1 };
        }
        self.changed.insert(id);
    }

    /// What a board is to be looked at for, now that it or its bound has changed.
    fn reconsider(&mut self, id: NodeId) {
        self.unsettled.insert(id);
        let node = &mut self.nodes[id];
        let needed = node.needed_at();
        let before = core::mem::replace(&mut node.listed, needed);
        if needed != before {
            self.needs.remove(&(before, id));
            if !needed.is_never() {
                self.needs.insert((needed, id));
            }
        }
    }

    /// Whether boards are yet to answer.
    pub const fn is_waiting(&self) -> bool {
        self.waiting > 0
    }

    /// Whether this board is yet to answer.
    pub fn awaits(&self, node: NodeId) -> bool {
        self.nodes[node].awaited
    }

    /// Whether nothing will ever happen on any line again unless something comes from outside.
    pub fn is_quiet(&self) -> bool {
        self.nodes.iter().all(Node::is_quiet) && self.next_change().is_never()
    }

    /// The first change on a line that comes from a fault.
    fn next_change(&self) -> Instant {
        let lines = self.disturbed.iter().map(|line| &self.lines[line]);
        let changes = lines.map(|line| line.next_change(|other, at| self.lines[other].driven(at)));
        changes.min().unwrap_or(Instant::NEVER)
    }

    /// When the rig fell [quiet](Self::is_quiet): the last instant at which a board became mute, or something happened
    /// on a line.
    pub fn quiet_since(&self) -> Instant {
        let since = self.nodes.iter().filter(|node| node.life == Life::Runs).filter_map(|node| node.mute_since);
        since.chain(self.lines.iter().map(Wire::last_change)).max().unwrap_or_default()
    }

    /// The rig is not [quiet](Self::is_quiet) before this instant, unless something comes from outside.
    pub fn active_until(&mut self) -> Instant {
        self.bound();
        // What a board was to do to a line can be cut short before.
        let change = Some(self.next_instant()).filter(|_| !self.next_change().is_never());
        self.nodes.iter().map(Node::active_until).chain(change).max().unwrap_or_default()
    }

    /// The silence of the world outside that some board waits for now.
    pub fn silence(&self) -> Option<Silence> {
        let begun = |(id, silence): &(NodeId, Silence)| silence.from < self.nodes[*id].commit;
        self.silences().filter(begun).map(|(_, silence)| silence).min_by_key(|silence| silence.deadline)
    }

    /// The first silence that each board waits for.
    fn silences(&self) -> impl Iterator<Item = (NodeId, Silence)> {
        let first = self.nodes.iter().enumerate().filter_map(|(id, node)| node.silence().map(|silence| (id, silence)));
        first.filter(|(id, silence)| {
            // What is about to come over a line is no silence.
            let ears = self.nodes[*id].hears.iter();
            let spoken = ears.filter_map(|(port, line)| {
                let from = self.lines[*line].from;
                let edge = self.nodes[from.node].told_edge(usize::from(from.port))?;
                self.nodes[*id].ears.get(*port).map(|ear| ear.effect(edge))
            });
            spoken.min().is_none_or(|effect| effect > silence.deadline)
        })
    }

    /// How far anything may be settled: while a board waits for silence, time goes no further than silence may.
    fn held_at(&self, limit: Limit) -> Instant {
        if limit.silence.is_never() {
            return limit.until;
        }
        let unproven = self.silences().filter(|(_, silence)| silence.deadline >= limit.silence);
        let held = unproven.map(|(_, silence)| limit.silence.max(silence.from.next()));
        held.min().unwrap_or(Instant::NEVER).min(limit.until)
    }

    /// The earliest instant that [`Engine::poll`] must be allowed to pass for something to happen on a line, an event
    /// to be told, or a silence to have lasted.
    pub fn next_instant(&self) -> Instant {
        let running = self.nodes.iter().filter(|node| node.life == Life::Runs && !node.awaited);
        let next = running.map(|node| node.next_instant()).min().unwrap_or(Instant::NEVER).min(self.next_change());
        self.silence().map_or(next, |silence| silence.deadline.min(next))
    }

    /// The board's process has stopped: it hangs, reset or not, from the end of what it has told, or from where it was
    /// to go on if it has not come as far. Says from when.
    pub fn stop(&mut self, node: NodeId) -> Instant {
        if self.nodes[node].life != Life::Runs {
            return self.nodes[node].commit;
        }
        let at = self.halt(node, Life::Stopped).max(self.nodes[node].resumed);
        self.hear(node, Heard::Stimulus { at, stimulus: Stimulus::Stop(true) });
        at
    }

    /// The board's process goes on; the board hangs no longer. Says from when.
    pub fn resume(&mut self, node: NodeId) -> Instant {
        let at = self.frontier();
        if self.nodes[node].life == Life::Stopped {
            (self.nodes[node].life, self.nodes[node].resumed) = (Life::Runs, at);
            self.hear(node, Heard::Stimulus { at, stimulus: Stimulus::Stop(false) });
        }
        at
    }

    /// What has become of a board's process.
    pub fn life(&self, node: NodeId) -> Life {
        self.nodes[node].life
    }

    /// What is at the other end of the line that a port sends on, or else of the one that it hears.
    pub fn other_end(&self, end: End) -> Option<End> {
        let sends = self.lines.iter().find(|wire| wire.from == end).map(|wire| wire.to);
        sends.or_else(|| self.lines.iter().find(|wire| wire.to == end).map(|wire| wire.from))
    }

    /// The end of what a board has told. Of one that is mute, stopped or gone this can lie before what is settled.
    pub fn told(&self, node: NodeId) -> Instant {
        self.nodes[node].horizon
    }

    /// The board is gone; nothing comes from it any more. Says from when.
    pub fn kill(&mut self, node: NodeId) -> Instant {
        self.halt(node, Life::Gone)
    }

    /// Settles what the board has told and nothing unheard can change; the rest will not come.
    fn halt(&mut self, node: NodeId, life: Life) -> Instant {
        self.bound();
        let safe = self.nodes[node].safe_until().min(self.reaction());
        let at = safe.min(self.frontier()).max(self.nodes[node].commit);
        self.settle(node, at);
        self.nodes[node].stop(at, life);
        self.note_change(node);
        at
    }

    fn hear(&mut self, node: NodeId, heard: Heard) {
        self.nodes[node].hear(heard);
        self.note_change(node);
    }

    /// The earliest instant at which whoever watches can act.
    fn reaction(&self) -> Instant {
        let hits = self.hits.iter().map(|hit| hit.at);
        let watched = self.watches.iter().map(|(_, watch)| self.nodes[watch.node].earliest_hit(watch));
        hits.chain(watched).min().map_or(Instant::NEVER, |at| at + REACTION)
    }

    /// Hands on what is sure on disturbed lines. Says whether there was any.
    fn pass(&mut self, until: Instant) -> bool {
        let mut moved = false;
        let mut next = 0;
        while let Some(line) = self.disturbed.first_from(next) {
            next = line + 1;
            let wire = &self.lines[line];
            let unheard_noise = wire.is_noisy() && self.nodes[wire.to.node].life != Life::Runs;
            // It would never end.
            let until = if until.is_never() && unheard_noise { self.frontier } else { until };
            let sure = self.sure_until(line).min(until);
            let committed = self.nodes[wire.from.node].commit;
            let (before, rest) = self.lines.split_at_mut(line);
            let Some((wire, after)) = rest.split_first_mut() else { break };
            let passed = wire.pass(sure, committed, |other, at| match other.checked_sub(line + 1) {
                Some(other) => after[other].driven(at),
                None => before[other].driven(at),
            });
            self.frontier = self.frontier.max(wire.settled());
            if !wire.is_disturbed() {
                self.disturbed.remove(line);
                self.agenda.look_at(line);
            }
            if let Some(edges) = passed {
                moved = true;
                self.tell(line, Passed::Edges(edges));
            }
        }
        moved
    }

    /// Whether there is a line to the board that comes only as the board goes.
    fn hears_noise(&self, id: NodeId) -> bool {
        let mut disturbed = self.disturbed.iter().map(|line| &self.lines[line]);
        disturbed.any(|wire| wire.to.node == id && wire.is_noisy())
    }

    /// Tells a line's receiver.
    fn tell(&mut self, line: LineId, passed: Passed) {
        self.unsure.insert(line);
        let End { node, port } = self.lines[line].to;
        match passed {
            Passed::Edges(edges) if edges.is_empty() => {}
            Passed::Edges(edges) => self.hear(node, Heard::Edges { port, edges }),
            Passed::Cut(at) => self.hear(node, Heard::Cut { port, at }),
        }
    }

    /// Makes facts of what can no longer be withdrawn from the lines.
    fn settle_lines(&mut self, until: Instant) {
        let until = until.min(self.reaction());
        let mut next = 0;
        while let Some(line) = self.unsure.first_from(next) {
            next = line + 1;
            let wire = &mut self.lines[line];
            let sure = self.nodes[wire.from.node].uncut_until().min(until);
            let edges = wire.take_sure(sure);
            self.frontier = self.frontier.max(wire.settled());
            if wire.is_sure() {
                self.unsure.remove(line);
            }
            if !edges.is_empty() {
                self.facts.push(Fact::Edges { line, edges });
            }
        }
    }

    /// Settles what a board has told before `until`. Says whether its earliest edges can be later than before:
    /// something went out on a line, or can no longer be cut short.
    fn settle(&mut self, id: NodeId, until: Instant) -> bool {
        let due = self.nodes[id].due(until);
        let (sent, last) = if due == 0 { (false, None) } else { self.settle_told(id, due) };
        let changed = sent | self.nodes[id].commit_to(until, last);
        self.frontier = self.frontier.max(self.nodes[id].commit);
        if changed {
            self.note_change(id);
        }
        changed
    }

    /// Settles the first `due` of what a board has told. Says whether something went out on a line, and when the last
    /// of it was.
    fn settle_told(&mut self, id: NodeId, due: usize) -> (bool, Option<Instant>) {
        let mut sent = false;
        let mut last = None;
        let watched = self.nodes[id].watched;
        // Whatever comes of it, the board tells nothing meanwhile.
        let mut ahead = core::mem::take(&mut self.nodes[id].ahead);
        for Timed { at, output } in ahead.drain(..due) {
            last = Some(at);
            if watched {
                self.look(id, at, &output);
            }
            match output {
                Output::Character { port, edges, end } => {
                    sent = true;
                    self.nodes[id].speak(port, end);
                    if let Some(line) = self.nodes[id].line_of(port) {
                        let passed = self.lines[line].carry(at, edges, end);
                        self.fired.extend(self.lines[line].take_fired());
                        if let Some(edges) = passed {
                            self.tell(line, Passed::Edges(edges));
                        }
                    }
                }
                Output::Cut { port } => {
                    sent = true;
                    self.nodes[id].speak(port, at);
                    if let Some(line) = self.nodes[id].line_of(port)
                        && let Some(passed) = self.lines[line].withdraw(at)
                    {
                        self.tell(line, passed);
                    }
                }
                Output::Telemetry { signal, value } => {
                    self.facts.push(Fact::Telemetry { node: id, at, signal, value });
                }
                Output::Event { event, value } => {
                    self.facts.push(Fact::Event { node: id, at, event, value });
                }
                Output::Pin { pin, what } => self.facts.push(Fact::Pin { node: id, at, pin, what }),
            }
        }
        self.nodes[id].ahead = ahead;
        (sent, last)
    }

    /// Notes what watches see.
    fn look(&mut self, node: NodeId, at: Instant, output: &Output) {
        for (watch, what) in &self.watches {
            if what.node == node && what.sees(output) {
                self.hits.push(Hit { watch: *watch, at });
            }
        }
    }

    /// Gives grants to the boards without which nothing moves, and to those only: the longer a board is left alone, the
    /// more it hears at once.
    fn wake(&mut self, until: Instant) -> Vec<(NodeId, Grant)> {
        if self.is_waiting() {
            return Vec::new();
        }
        let first = self.needs.first().map_or(Instant::NEVER, |(need, _)| *need);
        let together = |need: Instant| need < until && need <= first + TOGETHER;
        let mut needed: Vec<NodeId> =
            self.needs.iter().take_while(|(need, _)| together(*need)).map(|(_, id)| *id).collect();
        needed.sort_unstable();
        needed.into_iter().map(|id| (id, self.grant(id, Instant::START))).collect()
    }
}

#[cfg(test)]
mod chatterbox;
#[cfg(test)]
mod tests;
