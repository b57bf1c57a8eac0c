//! The digest: a hash of everything that happened on the lines and in the boards.

use std::fmt;

use torno_protocol::board::PinOutput;
use torno_protocol::line::Level;
use torno_protocol::time::Instant;
use torno_protocol::train::Train;
use xxhash_rust::xxh3::Xxh3;

use torno_engine::Fact;
use torno_protocol::layout::Layout;

/// Hashes facts, each line and each board in a stream of its own: in what order facts of different streams were settled
/// depends on how time was cut into grants, and must not show.
pub struct Digest {
    nodes: Vec<Stream>,
    lines: Vec<Stream>,
}

struct Stream {
    name: String,
    hash: Xxh3,
    /// What has been added and not hashed yet: the hash is fast on much at once.
    pending: Vec<u8>,
}

/// Bytes that are hashed at once.
const AT_ONCE: usize = 4_096;

/// The digest of a whole run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sum(u128);

impl fmt::Display for Sum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

impl Digest {
    /// A digest for a rig with this layout, of nothing yet.
    pub fn new(layout: &Layout) -> Self {
        let stream =
            |name: &String| Stream { name: name.clone(), hash: Xxh3::new(), pending: Vec::with_capacity(AT_ONCE) };
        Self {
            nodes: layout.boards.iter().map(|board| stream(&board.name)).collect(),
            lines: layout.lines.iter().map(|line| stream(&line.name)).collect(),
        }
    }

    /// Adds a fact.
    pub fn add(&mut self, fact: &Fact) {
        match fact {
            Fact::Edges { line, edges } => edges.iter().for_each(|edge| {
                self.lines[*line].add(edge.at, if edge.level == Level::High { 1 } else { 0 }, 0, 0);
            }),
            Fact::Telemetry { node, at, signal, value } => self.nodes[*node].add(*at, 3, *signal, *value),
            Fact::Event { node, at, event, value } => self.nodes[*node].add(*at, 4, *event, *value),
            Fact::Pin { node, at, pin, what: PinOutput::Level(level) } => {
                self.nodes[*node].add(*at, 5, *pin, i64::from(*level == Level::High));
            }
            // As it is told, not pulse by pulse.
            Fact::Pin { node, at, pin, what: PinOutput::Pulses(train) } => {
                let Train { first, nanos, per, count, high } = *train;
                self.nodes[*node].add(*at, 6, *pin, count.cast_signed());
                self.nodes[*node].add(first, 7, *pin, nanos.cast_signed());
                self.nodes[*node].add(first + high, 8, *pin, per.cast_signed());
            }
        }
    }

    /// The digest of everything added.
    pub fn sum(&self) -> Sum {
        let mut streams: Vec<&Stream> = self.nodes.iter().chain(&self.lines).collect();
        streams.sort_by(|a, b| a.name.cmp(&b.name));
        let mut hash = Xxh3::new();
        for stream in streams {
            hash.update(stream.name.as_bytes());
            hash.update(&stream.sum().to_le_bytes());
        }
        Sum(hash.digest128())
    }
}

impl Stream {
    fn add(&mut self, at: Instant, tag: u8, number: u8, value: i64) {
        let mut bytes = [0; 18];
        bytes[..8].copy_from_slice(&at.as_nanos().to_le_bytes());
        bytes[8..10].copy_from_slice(&[tag, number]);
        bytes[10..].copy_from_slice(&value.to_le_bytes());
        self.pending.extend_from_slice(&bytes);
        if self.pending.len() > AT_ONCE - bytes.len() {
            self.hash.update(&self.pending);
            self.pending.clear();
        }
    }

    fn sum(&self) -> u128 {
        let mut hash = self.hash.clone();
        hash.update(&self.pending);
        hash.digest128()
    }
}
