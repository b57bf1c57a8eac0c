//! The waveform dump: every line, and every pin that is added, as a one-bit signal (VCD, IEEE 1364-2005 §18).

use std::collections::BTreeMap;
use std::io;

use torno_protocol::board::Pin;
use torno_protocol::line::Level;
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

/// Collects the edges of every line, and of pins.
pub struct Waveforms {
    /// The lines come first.
    signals: Vec<Pin>,
}

impl Waveforms {
    /// The lines of a rig with this layout, idle so far.
    pub fn new(layout: &Layout) -> Self {
        Self { signals: layout.lines.iter().map(|line| Pin::new(&line.name, Level::High)).collect() }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        match fact {
            Fact::Edges { line, edges } => self.signals[*line].edges.extend(edges),
            Fact::Telemetry { .. } | Fact::Event { .. } => {}
        }
    }

    /// Adds pins with all that they have done.
    pub fn add_pins(&mut self, pins: Vec<Pin>) {
        self.signals.extend(pins);
    }

    /// Writes the dump; it goes on for `tail`, more than a character on the slowest line, after `end` and the last
    /// edge, so that the last stop bit is in it. Of edges that fall on one step, the last one counts.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn write(&self, output: impl io::Write, end: Instant, tail: Span, scale: Timescale) -> io::Result<()> {
        let mut writer = Writer::new(output);
        writer.comment("torno: every line of the rig, idle high")?;
        let (number, unit) = scale.number_and_unit();
        writer.timescale(number, unit)?;
        writer.add_module("rig")?;
        let ids = self.signals.iter().map(|signal| writer.add_wire(1, &signal.name)).collect::<io::Result<Vec<_>>>()?;
        writer.upscope()?;
        writer.enddefinitions()?;

        writer.timestamp(0)?;
        writer.begin(SimulationCommand::Dumpvars)?;
        for (id, signal) in ids.iter().zip(&self.signals) {
            writer.change_scalar(*id, value(signal.first))?;
        }
        writer.end()?;

        let mut changes: BTreeMap<u64, BTreeMap<usize, Level>> = BTreeMap::new();
        let mut last = end;
        for (place, Pin { first, edges, .. }) in self.signals.iter().enumerate() {
            let mut shown = *first;
            for (n, edge) in edges.iter().enumerate() {
                let step = scale.step(edge.at);
                let is_last = edges.get(n + 1).is_none_or(|next| scale.step(next.at) != step);
                if is_last && edge.level != shown {
                    shown = edge.level;
                    changes.entry(step).or_default().insert(place, shown);
                }
                last = last.max(edge.at);
            }
        }
        for (step, levels) in changes {
            writer.timestamp(step)?;
            for (place, level) in levels {
                writer.change_scalar(ids[place], value(level))?;
            }
        }
        writer.timestamp(scale.step(last + tail))?;
        writer.flush()
    }
}

const fn value(level: Level) -> Value {
    match level {
        Level::High => Value::V1,
        Level::Low => Value::V0,
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::line::Edge;

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
        let waveforms = Waveforms { signals: vec![Pin { name: "a".to_owned(), first: Level::High, edges }] };
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
}
