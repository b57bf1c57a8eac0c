//! The simplest simulator that can be right: one instant of the whole rig after the other. It knows of all faults from
//! the start, tells a receiver of each edge when it comes, and never of one that does not.

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::*;

/// A rig that is being simulated.
pub(super) struct Reference<'a> {
    ring: &'a Ring,
    cells: Vec<Cell<Chatterbox>>,
    lines: Vec<Line>,
    faults: Vec<Faulty<'a>>,
    /// The last instant at which something happened.
    now: Option<Instant>,
    facts: Vec<Fact>,
}

/// A line at the present instant.
struct Line {
    from: End,
    to: End,
    /// What its sender drives now.
    driven: Level,
    /// What its sender has committed and not driven yet.
    coming: VecDeque<Edge>,
    /// What its receiver sees now.
    seen: Level,
}

/// A fault, and how far it has got.
struct Faulty<'a> {
    /// Its place among the ring's.
    number: usize,
    fault: &'a Fault,
    random: ChaCha8Rng,
    /// When it acts, if it does not do so all the time.
    pulses: Vec<Pulse>,
    /// Characters that it still waits for.
    left: u64,
    fired: bool,
}

#[derive(Clone, Copy)]
struct Pulse {
    from: Instant,
    until: Instant,
    act: Act,
}

/// What a fault does to a level.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Act {
    Invert,
    Hold(Level),
}

impl<'a> Reference<'a> {
    pub(super) fn new(ring: &'a Ring) -> Self {
        let mut cells: Vec<Cell<Chatterbox>> = ring.boards.iter().cloned().map(Cell::new).collect();
        for (node, at, stimulus) in &ring.stimuli {
            cells[*node].hear(&Heard::Stimulus { at: *at, stimulus: stimulus.clone() });
        }
        let line = |(from, to)| Line { from, to, driven: Level::High, coming: VecDeque::new(), seen: Level::High };
        let mut faults: Vec<Faulty<'a>> = ring.faults.iter().enumerate().map(Faulty::new).collect();
        // Of several that meet the same character, the one that began first acts first.
        faults.sort_by_key(|faulty| faulty.fault.from);
        let lines = ring.ends().into_iter().map(line).collect();
        Self { ring, cells, lines, faults, now: None, facts: Vec::new() }
    }

    /// Everything that happens before `until`, and the faults that have met their character.
    pub(super) fn run(mut self, until: Instant) -> Outcome {
        while let Some(now) = self.next().filter(|next| *next < until) {
            self.now = Some(now);
            while let Some(node) = (0..self.cells.len()).find(|node| self.cells[*node].poll_timeout() == Some(now)) {
                let mut outputs = Vec::new();
                self.cells[node].run(now.next(), |_, output| outputs.push(output));
                outputs.into_iter().for_each(|output| self.put_out(node, now, output));
            }
            self.lines.iter_mut().for_each(|line| line.drive(now));
            self.faults.iter_mut().for_each(|faulty| faulty.make_noise(now));
            (0..self.lines.len()).for_each(|line| self.see(line, now));
        }
        let fired = self.faults.iter().filter(|faulty| faulty.fired).map(|faulty| faulty.number).collect();
        Outcome { facts: streams(self.facts, until), fired }
    }

    /// The next instant at which anything can happen.
    fn next(&self) -> Option<Instant> {
        let boards = self.cells.iter().filter_map(Cell::poll_timeout);
        let edges = self.lines.iter().filter_map(|line| line.coming.front()).map(|edge| edge.at);
        let faults = self.faults.iter().flat_map(Faulty::changes).filter(|at| Some(*at) > self.now);
        boards.chain(edges).chain(faults).min()
    }

    fn put_out(&mut self, node: NodeId, at: Instant, output: Output) {
        let line_of = |port: u8| self.lines.iter().position(|line| line.from == End { node, port }).unwrap();
        match output {
            Output::Character { port, edges, end } => {
                let line = line_of(port);
                let (start, mut edges) = (edges[0].at, edges.to_vec());
                for faulty in self.faults.iter_mut().filter(|faulty| faulty.fault.line == line) {
                    faulty.meet(at, start, &mut edges, end);
                }
                self.lines[line].coming.extend(edges);
            }
            Output::Cut { port } => {
                let line = line_of(port);
                let Line { driven, coming, .. } = &mut self.lines[line];
                coming.retain(|edge| edge.at < at);
                if coming.back().map_or(*driven, |edge| edge.level) == Level::Low {
                    coming.push_back(Edge { at, level: Level::High });
                }
            }
            Output::Telemetry { signal, value } => self.facts.push(Fact::Telemetry { node, at, signal, value }),
            Output::Pin { pin, what } => self.facts.push(Fact::Pin { node, at, pin, what }),
            Output::Event { event, value } => {
                self.facts.push(Fact::Event { node, at, event, value });
                if let Some((watched, reacts)) = self.ring.reacts
                    && (watched, 1) == (node, event)
                {
                    let at = at + REACTION;
                    self.cells[reacts].hear(&Heard::Stimulus { at, stimulus: reaction(at) });
                }
            }
        }
    }

    /// Tells the receiver of a line if what it sees changes now.
    fn see(&mut self, line: LineId, now: Instant) {
        let level = self.level(line, now);
        let Line { to, seen, .. } = &mut self.lines[line];
        if level != *seen {
            *seen = level;
            let edges = vec![Edge { at: now, level }];
            self.cells[to.node].hear(&Heard::Edges { port: to.port, edges: edges.clone() });
            self.facts.push(Fact::Edges { line, edges });
        }
    }

    /// What the receiver of a line sees now.
    fn level(&self, line: LineId, now: Instant) -> Level {
        let mut low = self.lines[line].driven == Level::Low;
        for faulty in self.faults.iter().filter(|faulty| faulty.lasts(now)) {
            match faulty.fault.what {
                Disturbance::Short(other) if other == line => low |= self.lines[faulty.fault.line].driven == Level::Low,
                Disturbance::Short(other) if faulty.fault.line == line => low |= self.lines[other].driven == Level::Low,
                _ => {}
            }
        }
        let here = self.faults.iter().filter(|faulty| faulty.fault.line == line);
        let acts: Vec<Act> = here.flat_map(|faulty| faulty.acts(now)).collect();
        if acts.contains(&Act::Hold(Level::High)) {
            return Level::High;
        }
        let inverted = acts.iter().filter(|act| **act == Act::Invert).count() % 2 == 1;
        if acts.contains(&Act::Hold(Level::Low)) || low != inverted { Level::Low } else { Level::High }
    }
}

impl Line {
    fn drive(&mut self, now: Instant) {
        while self.coming.front().is_some_and(|edge| edge.at <= now)
            && let Some(edge) = self.coming.pop_front()
        {
            self.driven = edge.level;
        }
    }
}

impl<'a> Faulty<'a> {
    fn new((number, fault): (usize, &'a Fault)) -> Self {
        let (seed, left) = match fault.what {
            Disturbance::Noise { seed, .. } => (seed, 0),
            Disturbance::Character { nth, .. } => (0, nth),
            _ => (0, 0),
        };
        let random = ChaCha8Rng::seed_from_u64(seed);
        let mut faulty = Self { number, fault, random, pulses: Vec::new(), left, fired: false };
        faulty.next_noise(fault.from);
        faulty
    }

    /// When it ends.
    fn end(&self) -> Instant {
        self.fault.healed.as_ref().map_or(Instant::NEVER, |healed| healed.at)
    }

    fn lasts(&self, now: Instant) -> bool {
        self.fault.from <= now && now < self.end()
    }

    /// What it does now to its own line.
    fn acts(&self, now: Instant) -> Vec<Act> {
        if !self.lasts(now) {
            return Vec::new();
        }
        match self.fault.what {
            Disturbance::Cut => vec![Act::Hold(Level::High)],
            Disturbance::Stuck(level) => vec![Act::Hold(level)],
            Disturbance::Short(_) => Vec::new(),
            Disturbance::Noise { .. } | Disturbance::Character { .. } => {
                let now = self.pulses.iter().filter(|pulse| pulse.from <= now && now < pulse.until);
                now.map(|pulse| pulse.act).collect()
            }
        }
    }

    /// When what it does can change.
    fn changes(&self) -> impl Iterator<Item = Instant> {
        let pulses = self.pulses.iter().flat_map(|pulse| [pulse.from, pulse.until]);
        pulses.chain([self.fault.from, self.end()])
    }

    /// Draws the next pulse of noise when the last one is over.
    fn make_noise(&mut self, now: Instant) {
        self.pulses.retain(|pulse| now < pulse.until || matches!(self.fault.what, Disturbance::Noise { .. }));
        if let Some(last) = self.pulses.last().map(|pulse| pulse.until).filter(|until| *until <= now) {
            self.next_noise(last);
        }
    }

    fn next_noise(&mut self, last: Instant) {
        let Disturbance::Noise { period, width, .. } = self.fault.what else { return };
        // Poisson's: exponentially distributed gaps.
        let chance = (1 + (self.random.next_u64() >> 11)) as f64 / (1u64 << 53) as f64;
        let gap = Span::from_nanos(1 + (-libm::log(chance) * period.as_nanos() as f64) as u64);
        let width = Span::from_nanos(1 + self.random.next_u64() % width.as_nanos().max(1));
        let from = last + gap;
        self.pulses = vec![Pulse { from, until: from + width, act: Act::Invert }];
    }

    /// A character is committed at `at` to its line. `start` and `end` are as the sender has them; other faults may
    /// have changed the edges.
    fn meet(&mut self, at: Instant, start: Instant, edges: &mut Vec<Edge>, end: Instant) {
        let Disturbance::Character { what, .. } = self.fault.what else { return };
        if !self.lasts(at) || self.left == 0 {
            return;
        }
        self.left -= 1;
        if self.left > 0 {
            return;
        }
        self.fired = true;
        let length = end.since(start);
        let mut pulse = |from, until, act| self.pulses.push(Pulse { from, until, act });
        match what {
            Tampering::Flip(bit) => {
                let tenths = |n: u64| start + Span::from_nanos(length.as_nanos() * n / 10);
                let bit = u64::from(bit).min(9);
                pulse(tenths(bit), tenths(bit + 1), Act::Invert);
            }
            Tampering::Drop => pulse(start, end, Act::Hold(Level::High)),
            Tampering::Double => {
                for (n, edge) in edges.iter().enumerate() {
                    if edge.level == Level::Low {
                        let rise = edges.get(n + 1).map_or(end, |rise| rise.at);
                        pulse(edge.at + length, rise + length, Act::Hold(Level::Low));
                    }
                }
            }
            Tampering::Delay { edge, by } => {
                let Some(last) = edges.len().checked_sub(1) else { return };
                let late = usize::from(edge).min(last);
                let at = end.min(edges[late].at + by);
                edges[late].at = at;
                if late < last && edges[late + 1].at <= at {
                    edges.remove(late + 1);
                    edges.remove(late);
                }
            }
        }
    }
}
