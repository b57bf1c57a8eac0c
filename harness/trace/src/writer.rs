//! Writes a trace, block by block.

use std::io::{self, Write};

use torno_protocol::time::Instant;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::format::{self, End, Header, MAGIC, PREFIX, VERSION};
use torno_engine::{Fact, Input};

/// A block is written when it has grown to this, in bytes.
const BLOCK: usize = 64 << 10;
/// Prefix, kind, and how far anything is settled.
const BEFORE_ENTRIES: usize = PREFIX + 9;

/// Writes a trace to anything. Each block is one write.
#[derive(Debug)]
pub struct Writer<W> {
    output: W,
    block: Vec<u8>,
    /// The number of the next block.
    number: u64,
    /// The instant of the last entry in the block.
    last: u64,
    settled: Instant,
    /// What has been written is good up to here.
    good: Instant,
    /// So many bytes have been written.
    written: u64,
}

impl<W: Write> Writer<W> {
    /// Begins a trace.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn new(mut output: W, header: &Header) -> io::Result<Self> {
        let mut file = MAGIC.to_vec();
        file.extend(VERSION.to_le_bytes());
        let mut block = vec![0; PREFIX];
        block.push(format::HEADER);
        block = format::put_header(header, block).map_err(io::Error::other)?;
        seal(&mut block, 0)?;
        file.extend(&block);
        output.write_all(&file)?;
        let block = Vec::with_capacity(BLOCK + BLOCK / 4);
        let written = file.len() as u64;
        Ok(Self { output, block, number: 1, last: 0, settled: Instant::START, good: Instant::START, written })
    }

    /// What it is written to.
    pub const fn output(&self) -> &W {
        &self.output
    }

    /// How many bytes have been written. What has been noted since is not among them.
    pub const fn written(&self) -> u64 {
        self.written
    }

    /// How far what has been written is good.
    pub const fn good(&self) -> Instant {
        self.good
    }

    /// Takes note of what came from outside, of what happened, and of how far anything is settled.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn note(&mut self, inputs: &[Input], facts: &[Fact], settled: Instant) -> io::Result<()> {
        if inputs.is_empty() && facts.is_empty() {
            return Ok(());
        }
        let before = self.settled;
        for input in inputs {
            self.begin();
            format::put_input(input, &mut self.last, &mut self.block).map_err(io::Error::other)?;
        }
        for fact in facts {
            self.begin();
            format::put_fact(fact, &mut self.last, &mut self.block);
            if self.block.len() >= BLOCK {
                // Some of what is settled is still to be noted.
                self.settled = before.max(settled);
                self.flush()?;
                self.good = before;
            }
        }
        self.settled = self.settled.max(settled);
        Ok(())
    }

    fn begin(&mut self) {
        if self.block.is_empty() {
            self.block.resize(BEFORE_ENTRIES, 0);
            self.last = 0;
        }
    }

    /// Writes what has been noted.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn flush(&mut self) -> io::Result<()> {
        if self.block.is_empty() {
            return Ok(());
        }
        self.block[PREFIX] = format::ENTRIES;
        self.block[PREFIX + 1..BEFORE_ENTRIES].copy_from_slice(&self.settled.as_nanos().to_le_bytes());
        self.write()?;
        self.good = self.settled;
        Ok(())
    }

    /// Ends the trace.
    ///
    /// # Errors
    /// Whatever writing gives.
    pub fn finish(&mut self, end: &End) -> io::Result<()> {
        self.flush()?;
        let block = self.end_block(end)?;
        self.put(&block)?;
        self.output.flush()
    }

    /// The block that would end the trace behind what has been written: with it, a copy of that is whole.
    ///
    /// # Errors
    /// If there is too much in it.
    pub fn end_block(&self, end: &End) -> io::Result<Vec<u8>> {
        let mut block = vec![0; PREFIX];
        block.push(format::END);
        block = postcard::to_extend(end, block).map_err(io::Error::other)?;
        seal(&mut block, self.number)?;
        Ok(block)
    }

    fn write(&mut self) -> io::Result<()> {
        let mut block = core::mem::take(&mut self.block);
        seal(&mut block, self.number)?;
        self.put(&block)?;
        block.clear();
        self.block = block;
        Ok(())
    }

    fn put(&mut self, block: &[u8]) -> io::Result<()> {
        self.number += 1;
        self.written += block.len() as u64;
        self.output.write_all(block)
    }
}

/// Fills in length and checksum.
fn seal(block: &mut [u8], number: u64) -> io::Result<()> {
    let (prefix, payload) = block.split_at_mut(PREFIX);
    let length = u32::try_from(payload.len()).map_err(|_| io::Error::other("a block is longer than 4 GiB"))?;
    prefix[..4].copy_from_slice(&length.to_le_bytes());
    prefix[4..].copy_from_slice(&xxh3_64_with_seed(payload, number).to_le_bytes());
    Ok(())
}
