//! A logic analyser on the lines of an encoder.

use torno_protocol::board::Pin;
use torno_protocol::line::{Edge, Level};
use torno_protocol::time::Instant;
use torno_stepper::{Axis, Channels};

/// What the lines of an axis's encoder have done: A, B, and the index mark Z.
#[derive(Clone, Debug)]
pub(crate) struct Probe {
    pins: [Pin; 3],
}

fn levels(channels: Channels) -> [Level; 3] {
    [channels.a, channels.b, channels.z].map(|high| if high { Level::High } else { Level::Low })
}

impl Probe {
    /// A probe on an axis that is as at power-on.
    pub(crate) fn new(axis: &Axis, name: &str) -> Self {
        let first = levels(axis.channels(Instant::START));
        let pin = |n: usize, line: &str| Pin::new(&format!("{name}_encoder_{line}"), first[n]);
        Self { pins: [pin(0, "a"), pin(1, "b"), pin(2, "z")] }
    }

    /// Notes what the lines do up to `until`, if nothing happens to the axis before. It must be called before anything
    /// does.
    pub(crate) fn note(&mut self, axis: &Axis, from: Instant, until: Instant) {
        self.see(from, axis.channels(from));
        for (at, channels) in axis.edges(until) {
            self.see(at, channels);
        }
    }

    fn see(&mut self, at: Instant, channels: Channels) {
        for (pin, level) in self.pins.iter_mut().zip(levels(channels)) {
            if pin.edges.last().map_or(pin.first, |edge| edge.level) != level {
                pin.edges.push(Edge { at, level });
            }
        }
    }

    /// The pins.
    pub(crate) fn pins(&self) -> [Pin; 3] {
        self.pins.clone()
    }
}
