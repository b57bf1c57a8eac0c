//! Cycles of a Fanuc lathe: G70 to G75.
//!
//! A contour is a list of blocks of the program. What these blocks ask for is found by executing them aside; the cycle
//! then cuts towards it.

use crate::block::{Block, Code, mask};
use crate::canon::{Feed, Motion};
use crate::contour::{Cut, Frame, NEAR, PASSES_MAX, Pockets, Segment, Step, point, rough, segments};
use crate::execute::{feed_of, whole};
use crate::fanuc::state::{State, target};
use crate::finding::{Read, fault};
use crate::machine::{Machine, Sink};

/// A cycle with a contour.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cycle {
    /// In tenths: G70 is 700.
    code: u16,
    /// Where the word stands.
    at: usize,
    /// The numbers of the contour's first and last block.
    pub(crate) blocks: [u32; 2],
    /// What is left for the finishing cut, in mm: in X as a radius, in Z.
    left: [f64; 2],
    depth: f64,
    lift: f64,
    away: [f64; 2],
    passes: u32,
}

/// Reads G70 to G73; none of a line that only sets values.
pub(crate) fn of(machine: &Machine, state: &mut State, block: &Block, code: Option<Code>) -> Read<Option<Cycle>> {
    let Some(Code { tenths: code, at, .. }) = code else { return Ok(None) };
    let value = |letter: u8| block.get(letter).map(|value| value * machine.unit);
    if block.has_any(const { mask(b"xz") }) {
        return fault(at, "the cycle takes U and W, not X and Z");
    }
    if !block.has_any(const { mask(b"pq") }) {
        match code {
            710 | 720 => {
                state.depth = value(if code == 710 { b'u' } else { b'w' }).or(state.depth);
                state.lift = value(b'r').unwrap_or(state.lift);
            }
            730 => {
                state.away = [value(b'u').unwrap_or(0.0), value(b'w').unwrap_or(0.0)];
                state.passes = match block.get(b'r') {
                    Some(passes) => Some(whole(passes, block.at(b'r'), "R of G73")?),
                    None => state.passes,
                };
            }
            _ => return fault(at, "G70 needs P and Q: the first and the last block of the contour"),
        }
        return Ok(None);
    }
    let number = |letter: u8| match block.get(letter) {
        Some(number) => whole(number, block.at(letter), "the number of a block"),
        None => fault(at, "the cycle needs P and Q: the first and the last block of the contour"),
    };
    let blocks = [number(b'p')?, number(b'q')?];
    let depth = match (block.get(b'd'), state.depth) {
        // Without a point it counts thousandths.
        (Some(depth), _) if depth >= 100.0 => depth / 1000.0 * machine.unit,
        (Some(depth), _) => depth * machine.unit,
        (None, Some(depth)) => depth,
        (None, None) if matches!(code, 710 | 720) => {
            return fault(at, "the depth of a cut is not known: expected U (G71), W (G72) or D before it");
        }
        (None, None) => 0.0,
    };
    if matches!(code, 710 | 720) && depth <= 0.0 {
        return fault(at, "the depth of a cut is more than 0");
    }
    let passes = match (code, state.passes) {
        (730, None | Some(0)) => return fault(at, "how often G73 cuts is not known: expected R before it"),
        (_, passes) => passes.unwrap_or(1),
    };
    let left = [value(b'u').unwrap_or(0.0) / 2.0, value(b'w').unwrap_or(0.0)];
    Ok(Some(Cycle { code, at, blocks, left, depth, lift: state.lift, away: state.away, passes }))
}

/// Cuts a contour, whose blocks ask for these motions. It is of the second type if its first block names both axes.
pub(crate) fn run(
    cycle: &Cycle,
    machine: &mut Machine,
    motions: &[Motion],
    second_type: bool,
    sink: Sink<'_>,
) -> Read<()> {
    let place = machine.in_machine(machine.at);
    let start = point(place);
    let contour = segments(start, motions);
    let at = cycle.at;
    if contour.len() < 2 {
        return fault(at, "the contour of the cycle has fewer than two motions");
    }
    let feed = feed_of(machine, &Block::default(), || 0.0, at);
    let cut = &mut Cut { machine, sink, feed: Feed::PerMinute(0.0), start: place };
    match cycle.code {
        700 => {
            for segment in &contour {
                cut.follow(segment, segment.feed);
            }
        }
        730 => {
            cut.feed = feed?;
            for pass in 0..cycle.passes {
                let rest = if cycle.passes == 1 { 0.0 } else { 1.0 - f64::from(pass) / f64::from(cycle.passes - 1) };
                let [x, z] = [0, 1].map(|nth| cycle.left[nth] + cycle.away[nth] * rest);
                cut.rapid([start[0] + z, start[1] + x]);
                for segment in &contour {
                    cut.follow(&segment.moved([z, x]), segment.feed.map(|_| cut.feed));
                }
                cut.rapid(start);
            }
            return Ok(());
        }
        code => {
            cut.feed = feed?;
            roughen(cycle, usize::from(code == 720), &contour, second_type, cut)?;
        }
    }
    cut.rapid(start);
    Ok(())
}

/// G71 and G72: level by level towards the contour, then along it. `along` is as in [`Frame`]. Type II cuts pockets,
/// one after the other.
fn roughen(cycle: &Cycle, along: usize, contour: &[Segment], second_type: bool, cut: &mut Cut<'_, '_>) -> Read<()> {
    let (at, start) = (cycle.at, point(cut.start));
    let (first, end) = (contour[0], contour[contour.len() - 1].to);
    let toward = first.to[1 - along] - start[1 - along];
    let way = end[along] - first.to[along];
    if toward.abs() < NEAR || way.abs() < NEAR {
        return fault(at, "the contour of the cycle must lead to the part, then along it");
    }
    let frame = Frame { along, signs: [way.signum(), -toward.signum()] };
    let left = [cycle.left[1], cycle.left[0]];
    let left_over: Vec<Segment> = contour.iter().map(|segment| segment.moved(left)).collect();
    let mut ahead = frame.contour(&left_over);
    if !ahead[1..].iter().all(Segment::is_forward) {
        return fault(at, format!("the contour of the cycle turns back in {}", ['Z', 'X'][along]));
    }
    let pockets = !ahead[1..].iter().all(Segment::is_outward);
    if pockets && !second_type {
        return fault(at, "the contour of the cycle has pockets: its first block needs both X (U) and Z (W) then");
    }
    let (slow, feed) = (first.feed.is_some(), Some(cut.feed));
    // The levels begin straight below the start, whatever is left along the part.
    let mut from = frame.contour(&[Segment::line(start, first.to)])[0].from;
    let begin = ahead[0].to;
    if pockets {
        from[0] = from[0].min(begin[0]);
    }
    ahead.splice(0..1, [[from, [from[0], begin[1]]], [[from[0], begin[1]], begin]].map(|[a, b]| Segment::line(a, b)));
    let steps = &mut |step: Step| match step {
        // At the start's level there is nothing to cut.
        Step::Pass { from: begin, .. } if begin[1] > from[1] - NEAR => {}
        Step::Pass { from: begin, to, entry } => {
            if !pockets {
                cut.to(frame.out(begin), slow);
            }
            cut.to(frame.out(to), true);
            // Out at 45 degrees, in a pocket less far on a short way.
            let out = if entry { cycle.lift } else { cycle.lift.min((to[0] - begin[0]).abs() / 2.0) };
            cut.rapid(frame.out([to[0] - out, to[1] + out]));
            cut.rapid(frame.out([begin[0], begin[1] + out]));
            if !entry {
                cut.to(frame.out(begin), true);
            }
        }
        // Without pockets, the last cut is the only one that follows the contour.
        _ if !pockets => {}
        Step::Dive { way, entry: true } if way.from == way.to => {}
        Step::Dive { way, entry: true } => cut.to(frame.out(way.to), slow),
        Step::Dive { way, .. } | Step::Follow(way) => cut.follow(&frame.segment(&way), feed),
        Step::Reach(to) => cut.to(frame.out(to), true),
    };
    if let Err(message) = rough(&ahead, cycle.depth, Pockets::Cut, steps) {
        return fault(at, message);
    }
    if pockets {
        cut.rapid(start);
    }
    cut.follow(&left_over[0], if slow { feed } else { None });
    for segment in &left_over[1..] {
        cut.follow(segment, feed);
    }
    Ok(())
}

/// G74 and G75: pecks along Z or along X.
pub(crate) fn peck(machine: &mut Machine, state: &mut State, block: &Block, along_z: bool, sink: Sink<'_>) -> Read<()> {
    let Some(to) = target(machine, block)? else {
        state.lift = block.get(b'r').map_or(state.lift, |lift| lift * machine.unit);
        return Ok(());
    };
    let start = machine.at;
    let (axis, across) = if along_z { (2, 0) } else { (0, 2) };
    // Steps count thousandths of a mm, or ten-thousandths of an inch.
    let unit = if machine.unit == 1.0 { 0.001 } else { 0.00254 };
    let step = |letter| block.get(letter).map(|steps: f64| steps.abs() * unit).filter(|step| *step > 0.0);
    let (peck, aside) = if along_z { (step(b'q'), step(b'p')) } else { (step(b'p'), step(b'q')) };
    let (depth, width) = (to[axis] - start[axis], to[across] - start[across]);
    let many = |way: f64, step: Option<f64>| step.map_or(1.0, |step| (way.abs() / step).ceil().max(1.0));
    let (pecks, rows) = (many(depth, peck), if width.abs() < NEAR { 0.0 } else { many(width, aside) });
    if pecks * (rows + 1.0) > PASSES_MAX as f64 {
        return fault(0, format!("the cycle has more than {PASSES_MAX} pecks"));
    }
    let feed = Some(feed_of(machine, block, || 0.0, 0)?);
    let reached = |nth: f64, all: f64, way: f64, step: Option<f64>| {
        if nth >= all { way } else { step.map_or(way, |step| step * nth * way.signum()) }
    };
    for row in 0..=rows as u32 {
        let mut place = start;
        place[across] += reached(f64::from(row), rows, width, aside);
        machine.go(place, None, 0, sink)?;
        for nth in 1..=pecks as u32 {
            place[axis] = start[axis] + reached(f64::from(nth), pecks, depth, peck);
            machine.go(place, feed, 0, sink)?;
            if f64::from(nth) < pecks {
                let mut back = place;
                back[axis] -= state.lift * depth.signum();
                machine.go(back, None, 0, sink)?;
            }
        }
        place[axis] = start[axis];
        machine.go(place, None, 0, sink)?;
    }
    machine.go(start, None, 0, sink)
}
