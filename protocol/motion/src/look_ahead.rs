//! The look-ahead: how fast each block begins, so that all that follow it can be kept.

use std::collections::VecDeque;

use crate::block::{Block, Overrides};

/// The part of a block that is still to be cut into segments.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cursor {
    /// Its number, from the front of the buffer.
    pub(crate) block: usize,
    /// What is left of it, mm.
    pub(crate) left: f64,
    /// The speed there, mm/s.
    pub(crate) speed: f64,
}

/// Sets how fast each block may begin at most: a limit of its junction, of itself and of the block before it.
pub(crate) fn limit_entries(blocks: &mut VecDeque<Block>, overrides: Overrides) {
    let mut before = f64::INFINITY;
    for block in blocks {
        let nominal = block.nominal(overrides);
        block.max_entry = max_entry(block.junction, nominal, before);
        before = nominal;
    }
}

/// The square of the fastest entry of a block.
pub(crate) fn max_entry(junction: f64, nominal: f64, before: f64) -> f64 {
    let slower = nominal.min(before);
    junction.min(slower * slower)
}

/// Plans the entry speeds of the blocks after the cursor. Those up to `planned` are final, because nothing that is
/// pushed later can raise them. Returns the new `planned`.
///
/// Two passes: backwards, each block must be able to brake to what follows it, and the last one to a stop; forwards,
/// each must be able to accelerate to what was found.
pub(crate) fn look_ahead(blocks: &mut VecDeque<Block>, cursor: Cursor, planned: usize) -> usize {
    let mut planned = planned.max(cursor.block);
    let mut exit = 0.0;
    for n in (planned + 1..blocks.len()).rev() {
        let block = &mut blocks[n];
        block.entry = block.max_entry.min(exit + 2.0 * block.acceleration * block.length);
        exit = block.entry;
    }
    for n in planned + 1..blocks.len() {
        let before = &blocks[n - 1];
        let (entry, length) = match n - 1 == cursor.block {
            true => (cursor.speed * cursor.speed, cursor.left),
            false => (before.entry, before.length),
        };
        let reached = entry + 2.0 * before.acceleration * length;
        let block = &mut blocks[n];
        if reached < block.entry {
            block.entry = reached;
            planned = n;
        } else if block.entry == block.max_entry {
            planned = n;
        }
    }
    planned
}
