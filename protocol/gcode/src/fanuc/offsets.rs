//! Coordinate systems and offsets of a Fanuc: G10 and G53.

use crate::block::{Block, Code, mask};
use crate::execute::whole;
use crate::finding::{Read, fault};
use crate::machine::{Machine, Sink};

/// G10: `L2 P1` is the origin of G54; without L, P is the number of a tool offset.
pub(crate) fn set(machine: &mut Machine, block: &Block) -> Read<()> {
    let Some(number) = block.get(b'p') else { return fault(0, "G10 needs a P word: the number of what it sets") };
    let number = whole(number, block.at(b'p'), "P of G10")? as usize;
    let Some(what) = block.get(b'l') else { return tool(block) };
    if what != 2.0 {
        return fault(block.at(b'l'), format!("G10 L{what} is not supported yet: expected L2, or no L word"));
    }
    if let Some(letter) = b"rqik".iter().find(|letter| block.has(**letter)) {
        return fault(block.at(*letter), format!("G10 L2 takes no {} word", letter.to_ascii_uppercase() as char));
    }
    if !(1..=6).contains(&number) {
        return fault(block.at(b'p'), "P of G10 L2 is 1 (G54) to 6 (G59)");
    }
    let mut origin = machine.systems[number - 1];
    for (axis, absolute, relative) in [(0, b'x', b'u'), (2, b'z', b'w')] {
        let scale = machine.scale(axis);
        match (block.get(absolute), block.get(relative)) {
            (Some(_), Some(_)) => {
                return fault(block.at(relative), "a line of G10 names an axis twice");
            }
            (Some(value), None) => origin[axis] = value * scale,
            (None, Some(value)) => origin[axis] += value * scale,
            (None, None) => {}
        }
    }
    if !Machine::is_near(&origin) {
        return fault(block.at(b'p'), "the origin is too far from zero");
    }
    machine.with_offsets(|machine| machine.systems[number - 1] = origin);
    Ok(())
}

/// An offset of a tool: there is no table of tools, so it can only be zero.
fn tool(block: &Block) -> Read<()> {
    match b"xzuwr".iter().find(|letter| block.get(**letter).is_some_and(|value| value != 0.0)) {
        Some(letter) => {
            fault(block.at(*letter), "a tool offset other than 0 is not supported yet: there is no table of tools")
        }
        None => Ok(()),
    }
}

/// G53: a rapid in the coordinates of the machine.
pub(crate) fn go_in_machine(machine: &mut Machine, block: &Block, motion: &Option<Code>, sink: Sink<'_>) -> Read<()> {
    if let Some(code) = motion.filter(|code| code.tenths != 0) {
        return fault(code.at, format!("G53 is a rapid: it does not go with {}", code.name()));
    }
    if let Some(letter) = b"uw".iter().find(|letter| block.has(**letter)) {
        return fault(block.at(*letter), "G53 takes X and Z, not U and W");
    }
    if !block.has_any(const { mask(b"xz") }) {
        return fault(0, "G53 needs X or Z");
    }
    let mut to = machine.at;
    for axis in [0, 2] {
        if let Some(place) = machine.axis_word(block, axis) {
            to[axis] = place - machine.offset(axis);
        }
    }
    machine.go(to, None, 0, sink)
}
