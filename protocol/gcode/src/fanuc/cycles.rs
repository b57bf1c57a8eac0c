//! Cycles of a Fanuc lathe: G70 to G75.
//!
//! A contour is a list of blocks of the program. What these blocks ask for is found by executing them aside; the cycle
//! then cuts towards it.

use crate::arc;
use crate::block::{Block, Code, mask};
use crate::canon::{Feed, Kind, Motion, Place, Plane, Turn};
use crate::execute::{feed_of, whole};
use crate::fanuc::state::{State, target};
use crate::finding::{Read, fault};
use crate::machine::{Machine, Sink};

/// So many passes of one cycle.
const PASSES_MAX: f64 = 10_000.0;
const NEAR: f64 = 1e-9;

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

/// A straight line or an arc of a contour, in the machine's coordinates.
#[derive(Clone, Copy, Debug)]
struct Segment {
    from: [f64; 4],
    to: [f64; 4],
    /// Centre in Z and X, sense.
    arc: Option<([f64; 2], Turn)>,
    /// None of a rapid.
    feed: Option<Feed>,
}

/// The segments of a contour that begins here.
fn segments(start: [f64; 4], motions: &[Motion]) -> Vec<Segment> {
    let mut from = start;
    let mut segments = Vec::new();
    for motion in motions {
        let (to, arc, feed) = match motion.kind {
            Kind::Rapid { to } => (to, None, None),
            Kind::Feed { to, feed } => (to, None, Some(feed)),
            Kind::Arc { to, centre, turn, feed, .. } => (to, Some((centre, turn)), Some(feed)),
            _ => continue,
        };
        let to = to.axes();
        segments.push(Segment { from, to, arc, feed });
        from = to;
    }
    segments
}

impl Segment {
    /// Whether it goes in one sense along an axis: 1, -1, or 0 if it does not move along it; none if it turns back.
    fn sense(&self, axis: usize) -> Option<i8> {
        let way = self.to[axis] - self.from[axis];
        let sense = if way.abs() < NEAR { 0 } else { way.signum() as i8 };
        let Some((centre, turn)) = self.arc else { return Some(sense) };
        let (from, to) = ([self.from[2], self.from[0]], [self.to[2], self.to[0]]);
        let radius = libm::hypot(from[0] - centre[0], from[1] - centre[1]);
        let short = arc::length(from, to, centre, turn, 1) <= radius * core::f64::consts::PI + NEAR;
        // It turns back where it is level with its centre on the other axis.
        let other = usize::from(axis == 2);
        let sides = (from[other] - centre[other], to[other] - centre[other]);
        let one_side = sides.0 * sides.1 >= -1e-6 && (sides.0.abs() > 1e-6 || sides.1.abs() > 1e-6);
        (short && one_side).then_some(sense)
    }

    /// Where it meets a level of one axis, on the other.
    fn meets(&self, axis: usize, level: f64) -> Option<f64> {
        let other = 2 - axis;
        let (a, b) = (self.from[axis], self.to[axis]);
        if level < a.min(b) - NEAR || level > a.max(b) + NEAR || (a - b).abs() < NEAR {
            return None;
        }
        let (from, to) = (self.from[other], self.to[other]);
        match self.arc {
            None => Some(from + (level - a) / (b - a) * (to - from)),
            Some((centre, _)) => {
                // The centre is Z, X; axis 0 is X.
                let (of_axis, of_other) = if axis == 0 { (centre[1], centre[0]) } else { (centre[0], centre[1]) };
                let radius = libm::hypot(a - of_axis, from - of_other);
                let half = libm::sqrt((radius * radius - (level - of_axis) * (level - of_axis)).max(0.0));
                let within = |place: &f64| (from.min(to) - 1e-4..=from.max(to) + 1e-4).contains(place);
                [of_other + half, of_other - half].into_iter().find(within).or(Some(to))
            }
        }
    }
}

/// Cuts a contour, whose blocks ask for these motions.
pub(crate) fn run(cycle: &Cycle, machine: &mut Machine, motions: &[Motion], sink: Sink<'_>) -> Read<()> {
    let start = machine.in_machine(machine.at);
    let contour = segments(start, motions);
    let at = cycle.at;
    if contour.len() < 2 {
        return fault(at, "the contour of the cycle has fewer than two motions");
    }
    let feed = feed_of(machine, &Block::default(), || 0.0, at);
    let cut = &mut Cut { machine, sink, feed: Feed::PerMinute(0.0), start };
    match cycle.code {
        700 => {
            for segment in &contour {
                cut.follow(segment, [0.0; 2], segment.feed);
            }
        }
        730 => {
            cut.feed = feed?;
            for pass in 0..cycle.passes {
                let rest = if cycle.passes == 1 { 0.0 } else { 1.0 - f64::from(pass) / f64::from(cycle.passes - 1) };
                let shift = [0, 1].map(|nth| cycle.left[nth] + cycle.away[nth] * rest);
                cut.rapid(shifted(start, shift));
                for segment in &contour {
                    cut.follow(segment, shift, segment.feed.map(|_| cut.feed));
                }
                cut.rapid(start);
            }
            return Ok(());
        }
        code => {
            cut.feed = feed?;
            let axis = if code == 710 { 0 } else { 2 };
            rough(cycle, axis, &contour, cut)?;
        }
    }
    cut.rapid(start);
    Ok(())
}

fn shifted(mut place: [f64; 4], shift: [f64; 2]) -> [f64; 4] {
    place[0] += shift[0];
    place[2] += shift[1];
    place
}

/// G71 and G72: level by level towards the contour, then along it. `axis` is the axis of the levels.
fn rough(cycle: &Cycle, axis: usize, contour: &[Segment], cut: &mut Cut<'_, '_>) -> Read<()> {
    let (at, along, start) = (cycle.at, 2 - axis, cut.start);
    let (first, rest) = (contour[0], &contour[1..]);
    let toward = first.to[axis] - start[axis];
    let way = rest[rest.len() - 1].to[along] - first.to[along];
    if toward.abs() < NEAR || way.abs() < NEAR {
        return fault(at, "the contour of the cycle must lead to the part, then along it");
    }
    let (down, forward) = (toward.signum(), way.signum());
    let steady = |segment: &Segment| {
        segment.sense(along).is_some_and(|sense| f64::from(sense) * forward >= 0.0)
            && segment.sense(axis).is_some_and(|sense| f64::from(sense) * down <= 0.0)
    };
    if !rest.iter().all(steady) {
        return fault(at, "the cycle is not supported yet for this contour: it has pockets, or turns back");
    }
    let [shift_axis, shift_along] = if axis == 0 { cycle.left } else { [cycle.left[1], cycle.left[0]] };
    let deepest = first.to[axis] + shift_axis;
    if ((deepest - start[axis]).abs() / cycle.depth) > PASSES_MAX {
        return fault(at, format!("the cycle has more than {PASSES_MAX} passes"));
    }
    let place = |level: f64, along_at: f64| {
        let mut place = start;
        (place[axis], place[along]) = (level, along_at);
        place
    };
    let end = rest[rest.len() - 1].to[along] + shift_along;
    let slow = first.feed.is_some();
    let mut level = start[axis] + down * cycle.depth;
    while (deepest - level) * down > NEAR {
        let stop = rest.iter().find_map(|segment| segment.meets(axis, level - shift_axis));
        let stop = stop.map_or(end, |stop| stop + shift_along);
        cut.to(place(level, start[along]), slow);
        cut.to(place(level, stop), true);
        // Out at 45 degrees.
        cut.rapid(place(level - down * cycle.lift, stop - forward * cycle.lift));
        cut.rapid(place(level - down * cycle.lift, start[along]));
        level += down * cycle.depth;
    }
    let shift = cycle.left;
    cut.follow(&first, shift, slow.then_some(cut.feed));
    for segment in rest {
        cut.follow(segment, shift, Some(cut.feed));
    }
    Ok(())
}

/// A tool that cuts, in the machine's coordinates.
struct Cut<'m, 's> {
    machine: &'m mut Machine,
    sink: Sink<'s>,
    feed: Feed,
    start: [f64; 4],
}

impl Cut<'_, '_> {
    fn emit(&mut self, to: [f64; 4], kind: Kind) {
        let offsets: [f64; 4] = core::array::from_fn(|axis| self.machine.offset(axis));
        self.machine.at = core::array::from_fn(|axis| to[axis] - offsets[axis]);
        self.machine.emit(kind, self.sink);
    }

    fn rapid(&mut self, to: [f64; 4]) {
        self.emit(to, Kind::Rapid { to: Place::of(to) });
    }

    fn to(&mut self, to: [f64; 4], slow: bool) {
        let feed = self.feed;
        let place = Place::of(to);
        self.emit(to, if slow { Kind::Feed { to: place, feed } } else { Kind::Rapid { to: place } });
    }

    fn follow(&mut self, segment: &Segment, shift: [f64; 2], feed: Option<Feed>) {
        let to = shifted(segment.to, shift);
        let place = Place::of(to);
        let kind = match (feed, segment.arc) {
            (None, _) => Kind::Rapid { to: place },
            (Some(feed), None) => Kind::Feed { to: place, feed },
            (Some(feed), Some((centre, turn))) => {
                let centre = [centre[0] + shift[1], centre[1] + shift[0]];
                Kind::Arc { to: place, plane: Plane::Zx, centre, turn, turns: 1, feed }
            }
        };
        self.emit(to, kind);
    }
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
    if pecks * (rows + 1.0) > PASSES_MAX {
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
