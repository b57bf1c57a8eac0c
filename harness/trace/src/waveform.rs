//! The waveform dump: every line as a one-bit signal (VCD, IEEE 1364-2005 §18).

use std::collections::BTreeMap;
use std::io;

use torno_protocol::line::{Edge, Level};
use torno_protocol::time::{Instant, Span};
use vcd::{SimulationCommand, TimescaleUnit, Value, Writer};

use torno_engine::Fact;
use torno_protocol::layout::Layout;

/// Collects the edges of every line.
pub struct Waveforms {
    lines: Vec<(String, Vec<Edge>)>,
}

impl Waveforms {
    /// The lines of a rig with this layout, idle so far.
    pub fn new(layout: &Layout) -> Self {
        Self { lines: layout.lines.iter().map(|line| (line.name.clone(), Vec::new())).collect() }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        match fact {
            Fact::Edges { line, edges } => self.lines[*line].1.extend(edges),
            Fact::Telemetry { .. } | Fact::Event { .. } => {}
        }
    }

    /// Writes the dump; it goes on for `tail`, more than a character on the slowest line, after `end` and the last
    /// edge, so that the last stop bit is in it.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn write(&self, output: impl io::Write, end: Instant, tail: Span) -> io::Result<()> {
        let mut writer = Writer::new(output);
        writer.comment("torno: every line of the rig, idle high")?;
        writer.timescale(1, TimescaleUnit::NS)?;
        writer.add_module("rig")?;
        let ids = self.lines.iter().map(|(name, _)| writer.add_wire(1, name)).collect::<io::Result<Vec<_>>>()?;
        writer.upscope()?;
        writer.enddefinitions()?;

        writer.timestamp(0)?;
        writer.begin(SimulationCommand::Dumpvars)?;
        for id in &ids {
            writer.change_scalar(*id, Value::V1)?;
        }
        writer.end()?;

        let mut changes: BTreeMap<Instant, Vec<(usize, Level)>> = BTreeMap::new();
        for (line, (_, edges)) in self.lines.iter().enumerate() {
            edges.iter().for_each(|edge| changes.entry(edge.at).or_default().push((line, edge.level)));
        }
        let mut last = end;
        for (at, levels) in changes {
            writer.timestamp(at.as_nanos())?;
            for (line, level) in levels {
                writer.change_scalar(ids[line], if level == Level::High { Value::V1 } else { Value::V0 })?;
            }
            last = last.max(at);
        }
        writer.timestamp((last + tail).as_nanos())?;
        writer.flush()
    }
}
