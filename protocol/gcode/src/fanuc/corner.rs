//! Corners between two straight cuts: `,R` rounds them, `,C` cuts them off.
//!
//! The first cut is held back until the second one is known.

use crate::block::{Block, mask};
use crate::canon::{Feed, Kind, Place, Plane, Turn};
use crate::fanuc::state::{State, target};
use crate::finding::{Read, fault};
use crate::machine::{Machine, Sink};

/// Two cuts whose directions differ by less have no corner.
const STRAIGHT: f64 = 1e-9;

/// A cut that ends in a corner.
#[derive(Clone, Debug)]
pub(crate) struct Corner {
    pub(crate) line: usize,
    from: [f64; 4],
    to: [f64; 4],
    feed: Feed,
    round: bool,
    /// The radius, or the length that is cut off of both; in mm.
    size: f64,
}

impl Corner {
    /// What is said of one behind which no second cut comes.
    pub(crate) fn without_end(&self) -> String {
        format!("the corner (,R or ,C) of line {} needs a G1 behind it", self.line)
    }
}

/// Holds back a cut that ends in a corner.
pub(crate) fn begin(
    machine: &mut Machine,
    state: &mut State,
    to: [f64; 4],
    feed: Feed,
    corner: (u8, f64, usize),
) -> Read<()> {
    let (letter, size, at) = corner;
    if size <= 0.0 {
        return fault(at, "the size of a corner (,R or ,C) is more than 0");
    }
    if !Machine::is_near(&machine.in_machine(to)) {
        return fault(at, "the corner is too far from zero");
    }
    let (line, from, size) = (machine.line, machine.at, size * machine.unit);
    state.corner = Some(Corner { line, from, to, feed, round: letter == b'r', size });
    machine.at = to;
    Ok(())
}

/// Cuts what is held back, if anything is, up to where the line's own cut begins. Returns where that ends.
pub(crate) fn end(
    machine: &mut Machine,
    state: &mut State,
    block: &Block,
    is_cut: bool,
    sink: Sink<'_>,
) -> Read<Option<[f64; 4]>> {
    let Some(corner) = state.corner.take() else { return Ok(None) };
    if !is_cut || !block.has_any(const { mask(b"xzuw") }) {
        return fault(0, corner.without_end());
    }
    let Some(to) = target(machine, block)? else { return Ok(None) };
    // In the plane Z X.
    let way = |from: [f64; 4], to: [f64; 4]| [to[2] - from[2], to[0] - from[0]];
    let (first, second) = (way(corner.from, corner.to), way(corner.to, to));
    let lengths = [first, second].map(|way| libm::hypot(way[0], way[1]));
    let at = b"xzuw".iter().find(|letter| block.has(**letter)).map_or(0, |letter| block.at(*letter));
    if lengths.iter().any(|length| *length < STRAIGHT) {
        return fault(
            at,
            format!("the corner of line {} lies between two cuts; one of them has no length", corner.line),
        );
    }
    let [a, b] = [(first, lengths[0]), (second, lengths[1])].map(|(way, length)| way.map(|part| part / length));
    let (cross, dot) = (a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
    if cross.abs() < STRAIGHT && dot < 0.0 {
        return fault(at, format!("the cut turns back behind line {}: there is no corner", corner.line));
    }
    let straight = cross.abs() < STRAIGHT;
    let half = libm::tan(libm::atan2(cross.abs(), dot) / 2.0);
    let needed = match (straight, corner.round) {
        (true, _) => 0.0,
        (false, true) => corner.size * half,
        (false, false) => corner.size,
    };
    if let Some(length) = lengths.into_iter().find(|length| needed > *length + STRAIGHT) {
        let line = corner.line;
        return fault(
            at,
            format!("the corner of line {line} is too large: it needs {needed:.4} mm of a cut of {length:.4} mm"),
        );
    }
    let along = |way: [f64; 2], by: f64| {
        let mut place = corner.to;
        (place[2], place[0]) = (place[2] + way[0] * by, place[0] + way[1] * by);
        place
    };
    let (begin, end) = (along(a, -needed), along(b, needed));
    let line = core::mem::replace(&mut machine.line, corner.line);
    machine.go(begin, Some(corner.feed), at, sink)?;
    if !straight && !corner.round {
        machine.go(end, Some(corner.feed), at, sink)?;
    } else if !straight {
        let side = cross.signum();
        let from = machine.in_machine(begin);
        let centre = [from[2] - a[1] * side * corner.size, from[0] + a[0] * side * corner.size];
        let turn = if side > 0.0 { Turn::Counterclockwise } else { Turn::Clockwise };
        let to = Place::of(machine.in_machine(end));
        machine.at = end;
        machine.emit(Kind::Arc { to, plane: Plane::Zx, centre, turn, turns: 1, feed: corner.feed }, sink);
    }
    machine.line = line;
    Ok(Some(to))
}
