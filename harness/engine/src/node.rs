//! What the engine knows of one board.

use std::collections::VecDeque;

use torno_protocol::board::{Output, Stimulus};
use torno_protocol::record::{Grant, Heard, Report, Silence, Timed};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Ear;

use super::sending::Sending;
use super::{LineId, Statistics, Watch};

/// A mute board that is further behind than this catches up before it is told what it hears: what it has done meanwhile
/// then comes in several reports. (Ours: some megabytes of a motor that turns. Tests do not go on for so long.)
const BEHIND: Span = if cfg!(test) { Span::from_millis(40) } else { Span::from_secs(100) };
/// A mute board that is watched runs so far at a time.
const WATCH_AHEAD: Span = Span::from_secs(1);
/// So much is kept of what a stopped board hears on a port: at the beginning, and again at the end. Noise makes many
/// edges of few characters.
pub(super) const KEPT: usize = 2_000;

/// What has become of a board's process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Life {
    /// It runs.
    Runs,
    /// It has been stopped; it may go on.
    Stopped,
    /// It is no more.
    Gone,
}

impl std::fmt::Display for Life {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Runs => "runs",
            Self::Stopped => "stopped",
            Self::Gone => "gone",
        })
    }
}

#[derive(Debug)]
pub(super) struct Node {
    pub(super) life: Life,
    /// Where it went on last, after it had been stopped.
    pub(super) resumed: Instant,
    pub(super) sends_to: Vec<Option<LineId>>,
    /// Which port hears which line.
    pub(super) hears: Vec<(usize, LineId)>,
    /// Everything before this instant is settled.
    pub(super) commit: Instant,
    /// What it has told beyond that, in order.
    pub(super) ahead: VecDeque<Timed>,
    /// How much of that goes out on ports.
    spoken: usize,
    /// It has told everything before this instant.
    pub(super) horizon: Instant,
    pub(super) mute_since: Option<Instant>,
    /// It has said so itself, and all that it has told since is kept: it was not stopped.
    said_mute: bool,
    /// Where it waits for the world outside to stay silent, as far as that is not settled.
    silences: Vec<Silence>,
    pub(super) ears: Vec<Ear>,
    /// The end of the last settled character on each port.
    pub(super) line_busy_until: Vec<Instant>,
    /// What it has not been told yet.
    heard: Vec<Heard>,
    /// The first instant at which `heard` matters.
    pub(super) effect: Instant,
    /// Resets and losses of supply that are not settled yet: what from outside cuts a character short. They can have
    /// waited for a stopped process to go on.
    resets: Vec<Instant>,
    /// It has been given a grant and has not answered.
    pub(super) awaited: bool,
    /// The first instant at which something unheard can matter to it, whoever watches.
    pub(super) eit: Instant,
    /// The line that `eit` comes from.
    pub(super) owes_eit_to: Option<LineId>,
    /// What its state says of the next edge on each port, when that was last looked at.
    pub(super) sending: Vec<Sending>,
    /// Its receivers say something else than then.
    pub(super) ears_changed: bool,
    /// It is counted among those that are yet to answer.
    pub(super) counted: bool,
    /// Where it is listed among those that need a grant.
    pub(super) listed: Instant,
    /// What it tells matters to somebody else: it must run even if it is mute.
    pub(super) watched: bool,
    pub(super) statistics: Statistics,
}

impl Node {
    pub(super) fn new(ports: usize) -> Self {
        Self {
            life: Life::Runs,
            resumed: Instant::START,
            sends_to: vec![None; ports],
            hears: Vec::new(),
            commit: Instant::START,
            ahead: VecDeque::new(),
            spoken: 0,
            horizon: Instant::START,
            mute_since: None,
            said_mute: false,
            silences: Vec::new(),
            ears: Vec::new(),
            line_busy_until: vec![Instant::START; ports],
            heard: Vec::new(),
            effect: Instant::NEVER,
            resets: Vec::new(),
            awaited: false,
            eit: Instant::NEVER,
            owes_eit_to: None,
            sending: vec![Sending::NOTHING; ports],
            ears_changed: false,
            counted: false,
            listed: Instant::NEVER,
            watched: false,
            statistics: Statistics::default(),
        }
    }

    /// Whether it could have told of more that lies before `until`, and can be asked to.
    pub(super) fn is_behind(&self, until: Instant) -> bool {
        self.life == Life::Runs && !self.awaited && self.horizon < until
    }

    /// The end of what is known of the board if nothing reaches it.
    pub(super) fn told_until(&self) -> Instant {
        if self.mute_since.is_some() && !self.watched { Instant::NEVER } else { self.horizon }
    }

    /// Up to here nothing can change what the board has told.
    pub(super) fn safe_until(&self) -> Instant {
        self.told_until().min(self.eit).min(self.effect)
    }

    /// Brings what its state says of its next edges up to date.
    pub(super) fn note_sending(&mut self) {
        if self.life != Life::Runs {
            self.sending.fill(Sending::NOTHING);
            return;
        }
        let own = if self.mute_since.is_some() { Instant::NEVER } else { self.horizon };
        let (told, cut) = (own.min(self.effect), self.uncut_until());
        for (sending, free) in self.sending.iter_mut().zip(&self.line_busy_until) {
            *sending = Sending { told, free: *free, cut };
        }
        // What comes first counts, so it is looked at last.
        for Timed { at, output } in self.ahead.iter().rev().filter(|told| speaks(told)).take(self.spoken) {
            let (port, told, cut) = match output {
                Output::Character { port, edges, .. } => {
                    (port, edges.first().map_or(told, |edge| told.min(edge.at)), cut)
                }
                Output::Cut { port } => (port, told, cut.min(*at)),
                Output::Telemetry { .. } | Output::Event { .. } | Output::Pin { .. } => continue,
            };
            if let Some(sending) = self.sending.get_mut(usize::from(*port)) {
                (sending.told, sending.cut) = (told, cut);
            }
        }
    }

    /// The first edge that the board is certain to send on a port if nothing more reaches it.
    pub(super) fn told_edge(&self, port: usize) -> Option<Instant> {
        self.ahead.iter().find_map(|told| match &told.output {
            Output::Character { port: p, edges, .. } if usize::from(*p) == port => edges.first().map(|edge| edge.at),
            _ => None,
        })
    }

    /// The line that a port sends on. What a board sends on a port that it does not have is lost.
    pub(super) fn line_of(&self, port: u8) -> Option<LineId> {
        self.sends_to.get(usize::from(port)).copied().flatten()
    }

    /// What it had told of a port has been done: the port's line carries a character up to `end`.
    pub(super) fn speak(&mut self, port: u8, end: Instant) {
        self.spoken -= 1;
        if let Some(busy_until) = self.line_busy_until.get_mut(usize::from(port)) {
            *busy_until = end;
        }
    }

    /// Before this instant nothing that is on its lines can be cut short. A process that does not run cuts nothing.
    pub(super) fn uncut_until(&self) -> Instant {
        if self.life != Life::Runs {
            return Instant::NEVER;
        }
        self.resets.iter().min().copied().unwrap_or(Instant::NEVER)
    }

    /// The earliest instant at which the board can tell what `watch` looks out for.
    pub(super) fn earliest_hit(&self, watch: &Watch) -> Instant {
        if self.life != Life::Runs {
            return Instant::NEVER;
        }
        let told = self.ahead.iter().find(|told| watch.sees(&told.output));
        told.map_or(Instant::NEVER, |told| told.at).min(self.safe_until())
    }

    /// How much it has told before `until` that is not settled.
    pub(super) fn due(&self, until: Instant) -> usize {
        let is_due = |told: &Timed| told.at < until;
        // Nearly always there is nothing, or all of it.
        if self.ahead.front().is_some_and(is_due) { self.ahead.partition_point(is_due) } else { 0 }
    }

    /// What it has told of `from` and later no longer holds. Says whether there was anything.
    fn take_back(&mut self, from: Instant) -> bool {
        let before = self.ahead.len();
        while self.ahead.back().is_some_and(|told| told.at >= from)
            && let Some(told) = self.ahead.pop_back()
        {
            self.spoken -= usize::from(speaks(&told));
        }
        self.ahead.len() < before
    }

    /// Everything before `until` is settled, what the board did last at `last`. Says whether a reset is settled.
    pub(super) fn commit_to(&mut self, until: Instant, last: Option<Instant>) -> bool {
        let until = if until.is_never() {
            // Nothing more is to come. Time has still gone past what has been done, and past the silences that have
            // lasted: what comes from outside follows on these.
            last.max(self.silences.last().map(|silence| silence.deadline)).map_or(self.commit, Instant::next)
        } else {
            until
        };
        if until <= self.commit {
            return false;
        }
        self.commit = until;
        self.silences.retain(|silence| silence.deadline >= until);
        let resets = self.resets.len();
        self.resets.retain(|reset| *reset >= until);
        self.resets.len() < resets
    }

    /// The first silence of the world outside that the board waits for, if nothing that it will hear breaks it.
    pub(super) fn silence(&self) -> Option<Silence> {
        let unbroken = |silence: &&Silence| self.life == Life::Runs && self.effect > silence.deadline;
        self.silences.first().filter(unbroken).copied()
    }

    /// The instant for which the board must take a grant before anything at or after it can be settled; never, if it
    /// need not.
    pub(super) fn needed_at(&self) -> Instant {
        let need = self.effect.min(self.told_until());
        if self.life == Life::Runs && !self.awaited && need < self.eit { need } else { Instant::NEVER }
    }

    /// The earliest instant at which something other than telemetry happens.
    pub(super) fn next_instant(&self) -> Instant {
        let told = self.ahead.iter().find(|told| !is_quiet(told));
        told.map_or(Instant::NEVER, |told| told.at).min(self.effect).min(self.told_until())
    }

    pub(super) fn is_quiet(&self) -> bool {
        match self.life {
            Life::Runs => {
                let told = |told: &Timed| !is_quiet(told);
                !self.awaited && self.mute_since.is_some() && self.effect.is_never() && !self.ahead.iter().any(told)
            }
            Life::Stopped | Life::Gone => true,
        }
    }

    /// Something happens on it at this instant or later, whatever it hears. If it is [quiet](Self::is_quiet): since
    /// when.
    pub(super) fn active_until(&self) -> Instant {
        // What it has told of this instant and later need not hold.
        let unheard = self.eit.min(self.effect);
        let told = |told: &&Timed| !is_quiet(told);
        let told = self.ahead.iter().rev().find(told).map(|told| told.at);
        match (self.life, self.mute_since) {
            (Life::Stopped | Life::Gone, _) => Instant::START,
            (Life::Runs, None) => self.commit.max(told.unwrap_or_default().max(self.horizon).min(unheard)),
            (Life::Runs, Some(_)) if !self.effect.is_never() => unheard,
            (Life::Runs, Some(since)) => told.unwrap_or(since).min(unheard),
        }
    }

    pub(super) fn hear(&mut self, heard: Heard) {
        if self.life == Life::Gone {
            return;
        }
        if let Heard::Stimulus { at, stimulus: Stimulus::Reset | Stimulus::Power(false) | Stimulus::Stop(false) } =
            heard
        {
            self.resets.push(at);
        }
        // Of several things on one port the first matters first, so the least over all is right.
        self.effect = self.effect.min(self.effect_of(&heard));
        let port = port_of(&heard);
        self.heard.push(heard);
        if self.life == Life::Stopped && port.is_some() {
            self.forget_middle(port);
        }
    }

    /// A board that is stopped may be so for hours. All that its receivers can keep are the first few characters, and
    /// what is coming in when it goes on; what lies between is lost on it, and need not be kept.
    fn forget_middle(&mut self, port: Option<u8>) {
        let mut on_port = (0..self.heard.len()).filter(|n| port_of(&self.heard[*n]) == port);
        if let Some(first_of_middle) = on_port.nth(KEPT)
            && on_port.count() >= KEPT
        {
            self.heard.remove(first_of_middle);
        }
    }

    /// Starts a grant: from here on, what was told for the instants that the board is about to hear of no longer holds.
    pub(super) fn grant(&mut self, until: Instant) -> Grant {
        self.awaited = true;
        self.statistics.grants += 1;
        if self.said_mute && !self.heard.is_empty() && self.horizon + BEHIND < self.effect {
            let until = if until == Instant::START { self.effect } else { until.min(self.effect) };
            return Grant { commit: self.commit, until, heard: Vec::new() };
        }
        self.statistics.redone += u64::from(self.take_back(self.effect));
        self.silences.retain(|silence| silence.deadline < self.effect);
        self.horizon = self.horizon.min(self.effect);
        if !self.effect.is_never() {
            self.mute_since = None;
        }
        let grant =
            Grant { commit: self.commit, until: until.max(self.extension()), heard: core::mem::take(&mut self.heard) };
        self.effect = Instant::NEVER;
        grant
    }

    /// A board that is woken without hearing anything must run past its horizon.
    fn extension(&self) -> Instant {
        match self.mute_since {
            _ if !self.heard.is_empty() => Instant::START,
            None => self.horizon.next(),
            Some(_) if self.watched && !self.horizon.is_never() => self.horizon + WATCH_AHEAD,
            Some(_) => Instant::START,
        }
    }

    pub(super) fn answer(&mut self, report: Report) {
        self.take_back(report.from);
        self.awaited = false;
        if self.life != Life::Runs {
            // An answer from before it was stopped: what could still be used of it has been settled.
            self.note_effect();
            return;
        }
        self.spoken += report.outputs.iter().filter(|told| speaks(told)).count();
        if self.ahead.is_empty() {
            self.ahead = report.outputs.into();
        } else {
            self.ahead.extend(report.outputs);
        }
        self.horizon = report.horizon;
        self.mute_since = report.mute_since;
        self.said_mute = report.mute_since.is_some();
        self.silences.retain(|silence| silence.deadline < report.from);
        self.silences.extend(report.silences);
        self.ears_changed |= self.ears != report.ears;
        self.ears = report.ears;
        self.note_effect();
    }

    /// Nothing it has told of `at` and later will come.
    pub(super) fn stop(&mut self, at: Instant, life: Life) {
        self.life = life;
        self.ahead.clear();
        self.spoken = 0;
        self.silences.clear();
        self.horizon = self.horizon.min(at);
        self.mute_since = Some(at);
        self.said_mute = false;
        if life == Life::Gone {
            self.heard.clear();
            self.awaited = false;
            self.effect = Instant::NEVER;
        }
    }

    fn note_effect(&mut self) {
        self.effect = self.heard.iter().map(|heard| self.effect_of(heard)).min().unwrap_or(Instant::NEVER);
    }

    /// The first instant at which something can matter to the board.
    fn effect_of(&self, heard: &Heard) -> Instant {
        let ear = |port: u8, at: Instant| self.ears.get(usize::from(port)).map_or(at, |ear| ear.effect(at));
        match heard {
            Heard::Edges { port, edges } => edges.first().map_or(Instant::NEVER, |edge| ear(*port, edge.at)),
            Heard::Cut { port, at } => ear(*port, *at),
            Heard::Stimulus { at, .. } => *at,
        }
    }
}

/// Whether it is told while nothing happens: with telemetry and pins alone a board goes on for ever.
fn is_quiet(told: &Timed) -> bool {
    matches!(told.output, Output::Telemetry { .. } | Output::Pin { .. })
}

/// Whether it goes out on a port.
fn speaks(told: &Timed) -> bool {
    matches!(told.output, Output::Character { .. } | Output::Cut { .. })
}

fn port_of(heard: &Heard) -> Option<u8> {
    match heard {
        Heard::Edges { port, .. } | Heard::Cut { port, .. } => Some(*port),
        Heard::Stimulus { .. } => None,
    }
}
