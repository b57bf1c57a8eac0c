//! What the buses of a rig cost: how long a frame takes, how long the PC is held, how well an axis follows, and what
//! goes over each line. Quantities are known by their roles, so that it serves any rig.

use std::collections::BTreeMap;

use torno_protocol::board::Role;
use torno_protocol::time::{Instant, Span};

use torno_bus::{Dialect, Ears, Phase, STOPPED, Stopwatch};
use torno_engine::{Fact, LineId, NodeId};
use torno_protocol::layout::{BoardLayout, Layout};

/// Takes note of what happens in a rig.
#[derive(Debug)]
pub struct Ledger {
    ears: Ears,
    stopwatch: Option<Box<dyn Stopwatch>>,
    /// The lines, each with its name, and whether the PC sends on it or hears it.
    lines: Vec<(String, bool, bool)>,
    pc: NodeId,
    /// Since when the PC is held, and how long it has been before.
    held_since: Option<Instant>,
    held: Span,
    boards: usize,
    axes: Vec<Follower>,
}

/// An axis's position and, if it has one, its set point.
#[derive(Clone, Debug)]
struct Follower {
    name: String,
    node: NodeId,
    position: u8,
    set_point: Option<u8>,
    at: Instant,
    values: [i64; 2],
    worst: i64,
}

/// A mean and the longest of so many times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spread {
    count: u64,
    sum: Span,
    /// The longest.
    pub worst: Span,
}

/// What became of an axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    /// The name of its board or, if that has several, of the motor.
    pub name: String,
    /// Where it ended, in counts.
    pub position: i64,
    /// How far it was from its set point when it was farthest, in counts.
    pub following_error: Option<i64>,
}

/// What the buses have cost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Account {
    /// How many boards there are.
    pub boards: usize,
    /// From the last byte of a frame that is not held to its `ACK`.
    pub answer: Spread,
    /// From the `XON` to the `ACK` of a frame that was held.
    pub held_answer: Spread,
    /// From the last byte of a frame to the `XON` after it.
    pub whole: Spread,
    /// From a frame's `ACK` to the `XON` after it.
    pub execution: Spread,
    /// How long the PC has been held in all.
    pub held: Span,
    /// The axes.
    pub axes: Vec<Axis>,
    /// The bytes on each line that is none of the PC's, by its name.
    pub bytes: BTreeMap<String, u64>,
    /// The bytes from the PC, and to it.
    pub pc_bytes: [u64; 2],
}

impl Spread {
    fn add(&mut self, time: Span) {
        self.count += 1;
        self.sum = self.sum + time;
        self.worst = self.worst.max(time);
    }

    /// The mean; None of nothing.
    pub fn mean_s(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum.as_secs_f64() / self.count as f64)
    }
}

impl Ledger {
    /// A ledger of nothing yet, for a rig with this layout whose PC speaks this dialect.
    pub fn new(layout: &Layout, dialect: &dyn Dialect) -> Self {
        let pc = layout.gateways().next().unwrap_or_default();
        let lines = layout.lines.iter().map(|line| (line.name.clone(), line.from.0 == pc, line.to.0 == pc)).collect();
        let axes = layout.boards.iter().enumerate().flat_map(|(node, board)| followers(node, board)).collect();
        Self {
            ears: Ears::new(layout),
            stopwatch: dialect.stopwatch(),
            lines,
            pc,
            held_since: None,
            held: Span::ZERO,
            boards: layout.boards.iter().filter(|board| !board.is_gateway()).count(),
            axes,
        }
    }

    /// Takes note of facts.
    pub fn add(&mut self, facts: &[Fact]) {
        self.ears.note(&[], facts);
        for fact in facts {
            let Fact::Telemetry { node, at, signal, value } = fact else { continue };
            if *node == self.pc && *signal == STOPPED {
                self.hold(*at, *value != 0);
            }
            self.axes.iter_mut().filter(|axis| axis.node == *node).for_each(|axis| axis.follow(*at, *signal, *value));
        }
    }

    fn hold(&mut self, at: Instant, held: bool) {
        if let Some(since) = self.held_since.take() {
            self.held = self.held + at.since(since);
        }
        self.held_since = held.then_some(at);
    }

    /// Closes it: the rig is quiet since `end`.
    pub fn close(mut self, end: Instant) -> Account {
        self.hold(end, false);
        let mut account = Account {
            boards: self.boards,
            answer: Spread::default(),
            held_answer: Spread::default(),
            whole: Spread::default(),
            execution: Spread::default(),
            held: self.held,
            axes: self.axes.into_iter().map(Follower::close).collect(),
            bytes: BTreeMap::new(),
            pc_bytes: [0; 2],
        };
        let between = self.lines.iter().filter(|(_, from_pc, to_pc)| !from_pc && !to_pc);
        account.bytes.extend(between.map(|(name, ..)| (name.clone(), 0)));
        for heard in self.ears.hear(Instant::NEVER) {
            account.count(&self.lines, heard.line);
            let Some(stopwatch) = &mut self.stopwatch else { continue };
            match (&self.lines[heard.line], heard.character.ok()) {
                ((_, true, _), _) => stopwatch.sent(heard.at, heard.character),
                ((_, _, true), Some(byte)) => {
                    let over = stopwatch.received(heard.at, byte);
                    over.into_iter().for_each(|(phase, time)| account.of(phase).add(time));
                }
                _ => {}
            }
        }
        account
    }
}

impl Account {
    const fn of(&mut self, phase: Phase) -> &mut Spread {
        match phase {
            Phase::Answer => &mut self.answer,
            Phase::HeldAnswer => &mut self.held_answer,
            Phase::Execution => &mut self.execution,
            Phase::Whole => &mut self.whole,
        }
    }

    fn count(&mut self, lines: &[(String, bool, bool)], line: LineId) {
        match &lines[line] {
            (_, true, _) => self.pc_bytes[0] += 1,
            (_, _, true) => self.pc_bytes[1] += 1,
            (name, ..) => *self.bytes.entry(name.clone()).or_default() += 1,
        }
    }
}

/// The axes of a board: each motor that has a position.
fn followers(node: NodeId, board: &BoardLayout) -> Vec<Follower> {
    let description = &board.description;
    let axis = |motor: u8| {
        Some(Follower {
            name: description.motor_name(motor).unwrap_or(&board.name).to_owned(),
            node,
            position: description.signal(motor, Role::Position, None)?,
            set_point: description.signal(motor, Role::SetPoint, None),
            at: Instant::START,
            values: [0; 2],
            worst: 0,
        })
    };
    (0..description.motors.len() as u8).filter_map(axis).collect()
}

impl Follower {
    fn follow(&mut self, at: Instant, signal: u8, value: i64) {
        let place = match signal {
            of if of == self.position => 0,
            of if Some(of) == self.set_point => 1,
            _ => return,
        };
        // What is told at one instant holds together.
        if at > self.at {
            self.look();
            self.at = at;
        }
        self.values[place] = value;
    }

    fn look(&mut self) {
        let [position, set_point] = self.values;
        self.worst = self.worst.max((set_point - position).abs());
    }

    fn close(mut self) -> Axis {
        self.look();
        let following_error = self.set_point.map(|_| self.worst);
        Axis { name: self.name, position: self.values[0], following_error }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::file::RigFile;

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    fn ledger(rig: &str) -> Ledger {
        let file = RigFile::load(rig).unwrap();
        Ledger::new(&file.layout, file.pc.dialect)
    }

    #[test]
    fn an_axis_is_known_by_the_roles_of_its_quantities() {
        let axes = |rig| ledger(rig).axes;
        let names = |rig| axes(rig).into_iter().map(|a| (a.name, a.set_point.is_some())).collect::<Vec<_>>();
        let expected = [("transverse".to_owned(), true), ("depth".to_owned(), false)];
        assert_eq!((names("lathe"), names("lathe-dspic")), (expected.to_vec(), expected.to_vec()));
    }

    #[test]
    fn what_is_told_at_one_instant_holds_together() {
        let mut ledger = ledger("lathe");
        let telemetry = |at, signal, value| Fact::Telemetry { node: 2, at, signal, value };
        let axis = &ledger.axes[0];
        let (position, set_point) = (axis.position, axis.set_point.unwrap());
        ledger.add(&[telemetry(ms(30), position, 100), telemetry(ms(30), set_point, 103)]);
        ledger.add(&[telemetry(ms(60), set_point, 110), telemetry(ms(60), position, 105)]);
        let account = ledger.close(ms(90));
        assert_eq!(account.axes[0], Axis { name: "transverse".to_owned(), position: 105, following_error: Some(5) });
    }

    #[test]
    fn a_pc_that_is_held_to_the_end_is_held_until_then() {
        let mut ledger = ledger("lathe");
        let pc = ledger.pc;
        let stopped = |at, value| Fact::Telemetry { node: pc, at, signal: STOPPED, value };
        ledger.add(&[stopped(ms(10), 1), stopped(ms(40), 0), stopped(ms(100), 1)]);
        assert_eq!(ledger.close(ms(150)).held, Span::from_millis(80));
    }
}
