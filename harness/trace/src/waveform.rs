//! The waveform dump: every line, and every pin that is added, as a one-bit signal (VCD, IEEE 1364-2005 §18).

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::{io, iter};

use torno_protocol::board::{OutputPin, Pin, PinOutput};
use torno_protocol::line::{Edge, Level};
use torno_protocol::time::{Instant, Span};
use vcd::{SimulationCommand, TimescaleUnit, Value, Writer};

use torno_engine::Fact;
use torno_protocol::layout::Layout;

/// The unit of time of a waveform dump. Edges are rounded to it, so a coarse one makes a small file that a logic
/// analyser reads quickly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timescale(u64);

impl Timescale {
    /// 1 us: a bit at 9600 baud lasts 104 of them.
    pub const MICROSECOND: Self = Self(1_000);
    /// 1 ns: what the rig's own time counts in.
    pub const NANOSECOND: Self = Self(1);

    /// A power of ten from 1 ns to 1 ms (IEEE 1364-2005 §18.2.3.7 knows 1, 10 and 100 of a unit).
    pub fn new(step: Span) -> Option<Self> {
        let nanos = step.as_nanos();
        (nanos <= 1_000_000 && nanos.checked_ilog10().is_some_and(|power| 10_u64.pow(power) == nanos))
            .then_some(Self(nanos))
    }

    fn number_and_unit(self) -> (u32, TimescaleUnit) {
        let (unit, one) = match self.0 {
            1_000_000.. => (TimescaleUnit::MS, 1_000_000),
            1_000.. => (TimescaleUnit::US, 1_000),
            _ => (TimescaleUnit::NS, 1),
        };
        ((self.0 / one) as u32, unit)
    }

    /// The nearest step.
    fn step(self, at: Instant) -> u64 {
        (at.as_nanos() + self.0 / 2) / self.0
    }
}

/// Collects what every line does, and pins.
pub struct Waveforms {
    /// The lines come first, then the output pins of each board.
    signals: Vec<Signal>,
    lines: usize,
    /// For each board, the place of its first output pin among the signals.
    outputs: Vec<usize>,
    /// Whether the output pins are in the dump.
    shows_outputs: bool,
}

struct Signal {
    name: String,
    first: Level,
    course: Course,
}

enum Course {
    Edges(Vec<Edge>),
    /// As they are told: trains become edges only when they are written.
    Outputs(Vec<(Instant, PinOutput)>),
}

impl Waveforms {
    /// The lines of a rig with this layout, idle so far, and its boards' output pins.
    pub fn new(layout: &Layout) -> Self {
        let line = |name: &String| Signal { name: name.clone(), first: Level::High, course: Course::Edges(Vec::new()) };
        let mut signals: Vec<Signal> = layout.lines.iter().map(|layout| line(&layout.name)).collect();
        let mut outputs = Vec::new();
        for board in &layout.boards {
            outputs.push(signals.len());
            signals.extend(board.description.pins.iter().map(|OutputPin { name, first }| Signal {
                name: format!("{}_{name}", board.name),
                first: *first,
                course: Course::Outputs(Vec::new()),
            }));
        }
        Self { signals, lines: layout.lines.len(), outputs, shows_outputs: false }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        let (place, fact) = match fact {
            Fact::Edges { line, .. } => (*line, fact),
            Fact::Pin { node, pin, .. } => (self.outputs[*node] + usize::from(*pin), fact),
            Fact::Telemetry { .. } | Fact::Event { .. } => return,
        };
        match (self.signals.get_mut(place).map(|signal| &mut signal.course), fact) {
            (Some(Course::Edges(all)), Fact::Edges { edges, .. }) => all.extend(edges),
            (Some(Course::Outputs(all)), Fact::Pin { at, what, .. }) => all.push((*at, *what)),
            _ => {}
        }
    }

    /// Adds pins with all that they have done, and shows the output pins.
    pub fn add_pins(&mut self, pins: Vec<Pin>) {
        self.shows_outputs = true;
        self.signals.extend(pins.into_iter().map(|Pin { name, first, edges }| Signal {
            name,
            first,
            course: Course::Edges(edges),
        }));
    }

    /// Writes the dump; it goes on for `tail`, more than a character on the slowest line, after `end` and the last
    /// edge, so that the last stop bit is in it. Of edges that fall on one step, the last one counts. Pulses that begin
    /// at `end` or later are not in it.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn write(&self, output: impl io::Write, end: Instant, tail: Span, scale: Timescale) -> io::Result<()> {
        let mut writer = Writer::new(output);
        writer.comment("torno: every line of the rig, idle high")?;
        let (number, unit) = scale.number_and_unit();
        writer.timescale(number, unit)?;
        writer.add_module("rig")?;
        let shown = if self.shows_outputs { &self.signals[..] } else { &self.signals[..self.lines] };
        let ids = shown.iter().map(|signal| writer.add_wire(1, &signal.name)).collect::<io::Result<Vec<_>>>()?;
        writer.upscope()?;
        writer.enddefinitions()?;

        writer.timestamp(0)?;
        writer.begin(SimulationCommand::Dumpvars)?;
        for (id, signal) in ids.iter().zip(shown) {
            writer.change_scalar(*id, value(signal.first))?;
        }
        writer.end()?;

        // Each signal's next change: a dump of many pulses takes no more memory than one of few.
        let mut changes: Vec<_> = shown.iter().map(|signal| signal.changes(end, scale)).collect();
        let mut next = BinaryHeap::new();
        let mut last = end;
        for (place, changes) in changes.iter_mut().enumerate() {
            next.extend(changes.next().map(|(step, level)| Reverse((step, place, level == Level::High))));
            if let Course::Edges(edges) = &shown[place].course {
                last = edges.last().map_or(last, |edge| last.max(edge.at));
            }
        }
        let mut time = None;
        while let Some(Reverse((step, place, high))) = next.pop() {
            if time.replace(step) != Some(step) {
                writer.timestamp(step)?;
            }
            writer.change_scalar(ids[place], value(if high { Level::High } else { Level::Low }))?;
            next.extend(changes[place].next().map(|(step, level)| Reverse((step, place, level == Level::High))));
        }
        writer.timestamp(scale.step(last + tail))?;
        writer.flush()
    }
}

impl Signal {
    /// The steps at which it changes, and to what.
    fn changes(&self, end: Instant, scale: Timescale) -> impl Iterator<Item = (u64, Level)> {
        let edges: Box<dyn Iterator<Item = Edge>> = match &self.course {
            Course::Edges(edges) => Box::new(edges.iter().copied()),
            Course::Outputs(outputs) => Box::new(edges_of(outputs, end)),
        };
        let mut edges = edges.peekable();
        let mut shown = self.first;
        iter::from_fn(move || {
            loop {
                let edge = edges.next()?;
                let step = scale.step(edge.at);
                let is_last = edges.peek().is_none_or(|next| scale.step(next.at) != step);
                if is_last && edge.level != shown {
                    shown = edge.level;
                    return Some((step, shown));
                }
            }
        })
    }
}

/// The edges of what an output pin does before `end`.
fn edges_of(outputs: &[(Instant, PinOutput)], end: Instant) -> impl Iterator<Item = Edge> {
    let untils = outputs.iter().skip(1).map(|(at, _)| *at).chain([end]);
    let pulses = outputs.iter().zip(untils).flat_map(move |((at, what), until)| {
        let (level, train) = match what {
            PinOutput::Level(level) => (Some((*at, *level)), None),
            PinOutput::Pulses(train) => (None, Some(train)),
        };
        let begun = train.map_or(0, |train| train.begun(until.min(end)));
        let pulses = train.into_iter().flat_map(move |train| {
            let high = train.high;
            (0..begun).map(|n| train.ticks().at(n)).map(move |rise| (rise, rise + high))
        });
        let levels = level.into_iter().filter(move |(at, _)| *at < end).map(|(at, level)| (at, level, None));
        levels.chain(pulses.map(|(rise, fall)| (rise, Level::High, Some(fall))))
    });
    // A pulse ends where the next edge comes before its end.
    let mut pulses = pulses.peekable();
    let mut fall = None;
    iter::from_fn(move || {
        if let Some(at) = fall.take().filter(|at| *at < end)
            && pulses.peek().is_none_or(|(next, ..)| at < *next)
        {
            return Some(Edge { at, level: Level::Low });
        }
        let (at, level, until) = pulses.next()?;
        fall = until;
        Some(Edge { at, level })
    })
}

const fn value(level: Level) -> Value {
    match level {
        Level::High => Value::V1,
        Level::Low => Value::V0,
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::board::Description;
    use torno_protocol::clock::Clock;
    use torno_protocol::layout::BoardLayout;
    use torno_protocol::train::Train;

    use super::*;

    #[test]
    fn a_timescale_is_a_power_of_ten() {
        let steps = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000];
        assert!(steps.iter().all(|nanos| Timescale::new(Span::from_nanos(*nanos)).is_some()));
        let wrong = [0, 2, 5, 99, 101, 1_001, 10_000_000, u64::MAX];
        assert!(wrong.iter().all(|nanos| Timescale::new(Span::from_nanos(*nanos)).is_none()));
    }

    #[test]
    fn edges_fall_on_the_nearest_step_and_what_is_shorter_is_not_shown() {
        let edge = |nanos, level| Edge { at: Instant::from_nanos(nanos), level };
        let edges = vec![
            edge(1_499, Level::Low),
            edge(2_500, Level::High),
            // A pulse within a step.
            edge(5_600, Level::Low),
            edge(6_400, Level::High),
        ];
        let mut waveforms = Waveforms::new(&Layout::default());
        waveforms.add_pins(vec![Pin { name: "a".to_owned(), first: Level::High, edges }]);
        let dump = |scale| {
            let mut text = Vec::new();
            waveforms.write(&mut text, Instant::START, Span::from_nanos(3_600), scale).unwrap();
            String::from_utf8(text).unwrap().replace('\n', " ")
        };
        let coarse = dump(Timescale::MICROSECOND);
        assert!(coarse.ends_with("#1 0! #3 1! #10 "), "{coarse}");
        let fine = dump(Timescale::NANOSECOND);
        assert!(fine.ends_with("#1499 0! #2500 1! #5600 0! #6400 1! #10000 "), "{fine}");
    }

    #[test]
    fn trains_become_edges_up_to_what_takes_their_place() {
        let at = Instant::from_nanos;
        let train = |first, count| Train { first: at(first), nanos: 100, per: 3, count, high: Span::from_nanos(10) };
        let pulses = |first, count| PinOutput::Pulses(train(first, count));
        let pin = OutputPin { name: "step".to_owned(), first: Level::Low };
        let description = Description { pins: vec![pin], ..Description::default() };
        let (name, kind) = ("axis".to_owned(), String::new());
        let board = BoardLayout { name, kind, clock: Clock::TRUE, description, receivers: Vec::new() };
        let mut waveforms = Waveforms::new(&Layout { boards: vec![board], lines: Vec::new() });
        let told = [
            (0, pulses(0, 2)),
            // Cut in its third pulse, which goes on to its end.
            (200, pulses(200, 5)),
            (270, pulses(270, 0)),
            (400, PinOutput::Level(Level::High)),
            (450, PinOutput::Level(Level::Low)),
            // The end cuts the last one.
            (500, pulses(500, 100)),
        ];
        for (ns, what) in told {
            waveforms.add(&Fact::Pin { node: 0, at: at(ns), pin: 0, what });
        }
        let dump = |waveforms: &Waveforms| {
            let mut text = Vec::new();
            waveforms.write(&mut text, at(534), Span::ZERO, Timescale::NANOSECOND).unwrap();
            String::from_utf8(text).unwrap().replace('\n', " ")
        };
        assert!(!dump(&waveforms).contains("axis_step"), "not asked for");
        waveforms.add_pins(Vec::new());
        let expected = "$dumpvars 0! $end #0 1! #10 0! #33 1! #43 0! #200 1! #210 0! #233 1! #243 0! #267 1! #277 0! \
                        #400 1! #450 0! #500 1! #510 0! #533 1! #534 ";
        let shown = dump(&waveforms);
        assert!(shown.ends_with(expected), "{shown}");
    }
}
