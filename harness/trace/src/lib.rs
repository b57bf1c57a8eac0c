//! Traces: the record of a whole session, which can be printed, repeated and compared.
//!
//! A trace stands alone: it holds the rig file's text, every fact that the engine settled, and every [`Input`] that
//! came from outside. The facts are what happened; the rig and the inputs are all that is needed to let it happen
//! again.
//!
//! # The file, version 5
//!
//! All fixed numbers are little-endian. `varint` is an unsigned LEB128 as `postcard` writes it, at most ten bytes;
//! `zigzag` is a signed number as a varint of `(n << 1) ^ (n >> 63)`.
//!
//! ```text
//! file    = magic (89 't' 'o' 'r' 'n' 'o' 0D 0A), version (2 bytes), block...
//! block   = length of the payload (4 bytes), XXH3-64 of the payload with the block's number as seed (8), payload
//! payload = 00, header              the first block, and no other: `postcard` of `format::Header`, and behind it
//!                                   for each board a list of `ReceiverKind`, or nothing (older traces)
//!         | 01, settled (8), entry...    nanoseconds: how far anything had been settled when the block was written
//!         | 02, end                 the last block: `postcard` of `format::End`
//! entry   = tag: varint of kind + 8 * number, at: zigzag nanoseconds since the entry before (since 0 in a new block),
//!           0 edges      the number is the line's: varint count, then for each edge after its predecessor (the first
//!                        one after `at`) varint of nanoseconds, with the level (0 low, 1 high) below its lowest bit
//!           1 telemetry  the number is the board's: signal (1 byte), zigzag value
//!           2 event      the number is the board's: event (1 byte), zigzag value
//!           3 input      the number is 0: varint of `given`, `postcard` of `rig::What`
//!           4 pin        the number is the board's: pin (1 byte), then 1 (low), 2 (high), or 0 and a train of pulses:
//!                        varints of the nanoseconds from `at` to the first rising edge, of the nanoseconds that a
//!                        number of periods take, of that number, of the pulses' number, and of how long each is high
//! ```
//!
//! Instants are nanoseconds since the rig started, below 2^63. Facts of one line are in order, and so are those of one
//! board; facts of different ones are in the order in which they were settled, which means nothing. An input stands
//! before whatever depends on it.
//!
//! The number as seed tells a block that is missing or out of place from one that is sound. A block is written whole,
//! when it has grown to 64 KiB, or once in a second of wall time. So a trace whose writer was killed lacks its end,
//! what was noted in the last second, and perhaps a part of its last block, and is good up to there.

pub mod analyser;
pub mod diff;
mod digest;
mod format;
mod reader;
pub mod rows;
mod v3;
mod v4;
mod waveform;
mod writer;

use torno_bus::{Ears, LineCharacter};
use torno_engine::{Fact, Input};
use torno_protocol::time::Instant;

pub use digest::{Digest, Sum};
pub use format::{End, Header, MAGIC, VERSION};
pub use reader::{Damage, read};
pub use waveform::{Timescale, Waveforms};
pub use writer::Writer;

/// A trace, as far as it could be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trace {
    /// What was recorded.
    pub header: Header,
    /// What happened.
    pub facts: Vec<Fact>,
    /// What came from outside.
    pub inputs: Vec<Input>,
    /// How far anything had been settled at the end of what could be read.
    pub settled: Instant,
    /// How it ended, if that is recorded.
    pub end: Option<End>,
}

impl Trace {
    /// A trace in which nothing has happened yet.
    pub const fn new(header: Header) -> Self {
        Self { header, facts: Vec::new(), inputs: Vec::new(), settled: Instant::START, end: None }
    }

    /// The instant that everything in it lies before.
    pub fn until(&self) -> Instant {
        self.end.as_ref().map_or(self.settled, |end| end.at.next())
    }

    /// The characters on all lines, in order of time.
    pub fn characters(&self) -> Vec<LineCharacter> {
        let mut ears = Ears::new(&self.header.layout);
        ears.note(&self.inputs, &self.facts);
        ears.hear(Instant::NEVER)
    }

    /// How many characters a receiver has got with an error.
    pub fn line_errors(&self) -> u64 {
        let bad = |heard: &&LineCharacter| heard.character.ok().is_none() && heard.at < self.until();
        self.characters().iter().filter(bad).count() as u64
    }
}
