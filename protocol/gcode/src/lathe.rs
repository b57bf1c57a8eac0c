//! LinuxCNC's cycles of a lathe: G70 finishes a contour, G71 and G72 rough towards it. The contour is a subroutine.

use crate::block::{Block, mask};
use crate::canon::{Feed, Plane, Turn};
use crate::contour::{Cut, Frame, PASSES_MAX, Pockets, Point, Segment, Step, offset, point, rough, segments};
use crate::execute::{execute, feed_of, whole};
use crate::finding::{Read, fault};
use crate::machine::{FeedMode, Machine, Sink};

/// A cycle, as its line asks for it. All lengths are in mm, and radii.
#[derive(Clone, Debug)]
pub(crate) struct Cycle {
    /// In tenths: G71.1 is 711.
    code: u16,
    /// Where the word stands.
    at: usize,
    /// The number of the subroutine, and where it stands.
    pub(crate) sub: (u32, usize),
    /// From where it cuts, in the program's coordinates.
    start: [f64; 4],
    /// How far from the contour it cuts first (G70), or at the end.
    distance: f64,
    /// How far from the contour G70 cuts at the end.
    end: f64,
    depth: f64,
    retract: f64,
    passes: u32,
}

impl Cycle {
    /// Reads the line.
    pub(crate) fn of(machine: &Machine, block: &Block, code: u16) -> Read<Self> {
        let at = block.codes().iter().find(|word| word.letter == b'g' && word.tenths == code).map_or(0, |word| word.at);
        let finishes = code == 700;
        let (unused, name) =
            if finishes { (&b"ijklrya"[..], "G70 takes") } else { (&b"ejklpya"[..], "G71 and G72 take") };
        if let Some(letter) = unused.iter().find(|letter| block.has(**letter)) {
            let word = letter.to_ascii_uppercase() as char;
            return fault(block.at(*letter), format!("{name} no {word} word"));
        }
        if machine.plane != Plane::Zx {
            return fault(at, "the cycle is for the plane X Z: expected G18 before it");
        }
        if !machine.absolute {
            return fault(at, "the cycle goes with absolute coordinates (G90)");
        }
        if machine.feed_mode == FeedMode::InverseTime {
            return fault(at, "the cycle does not go with G93");
        }
        let Some(sub) = block.get(b'q') else {
            return fault(at, "the cycle needs a Q word: the subroutine of its contour");
        };
        let sub = (whole(sub, block.at(b'q'), "the number of a subroutine")?, block.at(b'q'));
        let mut start = machine.at;
        for axis in [0, 2] {
            start[axis] = machine.axis_word(block, axis).unwrap_or(start[axis]);
        }
        if !Machine::is_near(&machine.in_machine(start)) {
            return fault(at, "the cycle starts too far from zero");
        }
        let length = |letter, otherwise: f64| block.get(letter).unwrap_or(otherwise) * machine.unit;
        for letter in *b"der" {
            if block.get(letter).is_some_and(|value| value < 0.0) {
                let word = letter.to_ascii_uppercase() as char;
                return fault(block.at(letter), format!("{word} of the cycle is 0 or more"));
            }
        }
        let depth = length(b'i', 1.0);
        if depth <= 0.0 {
            return fault(block.at(b'i'), "I of the cycle, the depth of a cut, is more than 0");
        }
        let passes = whole(block.get(b'p').unwrap_or(1.0), block.at(b'p'), "P of G70")?;
        if passes == 0 || passes as usize > PASSES_MAX {
            return fault(block.at(b'p'), format!("P of G70 is 1 to {PASSES_MAX}"));
        }
        let (distance, end, retract) = (length(b'd', 0.0), length(b'e', 0.0), length(b'r', 0.5));
        Ok(Self { code, at, sub, start, distance, end, depth, retract, passes })
    }

    /// The machine that reads the contour: it stands where the cycle starts.
    pub(crate) fn reader(&self, machine: &Machine) -> Machine {
        let mut reader = machine.clone();
        reader.at = self.start;
        reader.motion = None;
        reader
    }
}

/// Executes a line of a contour.
pub(crate) fn read(reader: &mut Machine, block: &Block, sink: Sink<'_>) -> Read<()> {
    if let Some(code) =
        block.codes().iter().find(|code| code.letter != b'g' || !matches!(code.tenths, 0 | 10 | 20 | 30))
    {
        return fault(code.at, format!("a contour holds G0 to G3 only, not {}", code.name()));
    }
    if let Some(letter) = b"abcdehjlpqstuvwy".iter().find(|letter| block.has(**letter)) {
        let word = letter.to_ascii_uppercase() as char;
        return fault(block.at(*letter), format!("a contour takes no {word} word"));
    }
    if block.codes().is_empty() && reader.motion == Some(30) && block.has_any(const { mask(b"xz") }) {
        return fault(0, "an arc of a contour needs its G3 in the line: LinuxCNC takes it for G2");
    }
    if block.has(b'r') && block.get(b'r').is_some_and(|radius| radius < 0.0) {
        return fault(block.at(b'r'), "R of an arc of a contour is more than 0");
    }
    let feed = reader.feed;
    if block.has(b'f') {
        reader.warn(block.at(b'f'), "F in a contour has no effect: the cycle cuts with the feed of its line");
    }
    execute(reader, block, true, sink)?;
    reader.feed = feed;
    Ok(())
}

/// Cuts a contour, whose lines ask for these motions.
pub(crate) fn run(cycle: &Cycle, machine: &mut Machine, motions: &[crate::canon::Motion], sink: Sink<'_>) -> Read<()> {
    let place = machine.in_machine(cycle.start);
    let mut contour = segments(point(place), motions);
    contour.retain(|segment| segment.from != segment.to || segment.arc.is_some());
    let at = cycle.at;
    if contour.len() < 2 || contour[0].arc.is_some() {
        return fault(at, "the contour of the cycle needs a straight motion to its start, and one more");
    }
    let feed = feed_of(machine, &Block::default(), || 0.0, at)?;
    let cut = &mut Cut { machine, sink, feed, start: place };
    cut.rapid(point(place));
    let last =
        if cycle.code == 700 { finish(cycle, &contour, feed, cut) } else { roughen(cycle, &contour, feed, cut) }?;
    machine.motion = Some(last);
    Ok(())
}

/// The frame of a contour; `along` as in [`Frame`].
fn frame(contour: &[Segment], along: usize) -> Frame {
    let (first, last) = (contour[0].to, contour[contour.len() - 1].to);
    let [forward, outward] = [along, 1 - along].map(|nth| last[nth] - first[nth]);
    // Where neither sense is asked for, a contour leads to negative Z, or to negative X.
    let side = if along == 0 { 1.0 } else { -1.0 };
    let signs = [if forward > 0.0 { 1.0 } else { -1.0 }, if outward * side < 0.0 { -side } else { side }];
    Frame { along, signs }
}

/// The word of the last motion along a contour.
fn code_of(segment: &Segment) -> u16 {
    match segment.arc {
        None => 10,
        Some((_, Turn::Clockwise)) => 20,
        Some((_, Turn::Counterclockwise)) => 30,
    }
}

fn no_room<T>(at: usize) -> Read<T> {
    fault(at, "the contour of the cycle has no room for the distance that is to be left")
}

/// G70: along the contour, nearer to it each time.
fn finish(cycle: &Cycle, contour: &[Segment], feed: Feed, cut: &mut Cut<'_, '_>) -> Read<u16> {
    let plain = Frame { along: 0, signs: [-1.0, 1.0] }.contour(contour);
    let frame = frame(contour, usize::from(!plain.iter().all(Segment::is_forward)));
    let contour = frame.contour(contour);
    let passes = f64::from(cycle.passes);
    for pass in (0..cycle.passes).rev() {
        let by = f64::from(pass) * (cycle.distance - cycle.end) / passes + cycle.end;
        let Some(moved) = offset(&contour, by) else { return no_room(cycle.at) };
        cut.rapid(frame.out(moved[0].from));
        cut.rapid(frame.out(moved[0].to));
        for segment in &moved[1..] {
            cut.follow(&frame.segment(segment), Some(feed));
        }
    }
    Ok(code_of(&contour[contour.len() - 1]))
}

/// G71 and G72.
fn roughen(cycle: &Cycle, contour: &[Segment], feed: Feed, cut: &mut Cut<'_, '_>) -> Read<u16> {
    let at = cycle.at;
    let frame = frame(contour, usize::from(cycle.code >= 720));
    let Some(contour) = offset(&frame.contour(contour), cycle.distance) else { return no_room(at) };
    if !contour.iter().all(Segment::is_forward) {
        let axis = if frame.along == 0 { 'Z' } else { 'X' };
        return fault(at, format!("the contour of the cycle turns back in {axis}, or starts behind the cycle's start"));
    }
    if contour[0].from[1] <= contour[0].to[1] {
        return fault(at, "the cycle starts inside of the contour: it cuts from outside");
    }
    let pockets = match cycle.code % 10 {
        0 => Pockets::Cut,
        1 => Pockets::Leave,
        _ => Pockets::Only,
    };
    let mut last = 0;
    cut.rapid(frame.out(contour[0].from));
    let steps = &mut |step: Step| {
        last = match step {
            Step::Dive { way, entry: true } => {
                cut.rapid(frame.out(way.to));
                0
            }
            Step::Dive { way, .. } | Step::Follow(way) => {
                let way = frame.segment(&way);
                cut.follow(&way, Some(feed));
                code_of(&way)
            }
            Step::Reach(to) => {
                cut.to(frame.out(to), true);
                10
            }
            Step::Pass { from, to, entry } => {
                cut.to(frame.out(to), true);
                // Out at 45 degrees, less far on a short way.
                let out = cycle.retract.min((to[0] - from[0]).abs() / 2.0);
                let raised = |[along, level]: Point, ahead: f64| frame.out([along + ahead, level + out]);
                cut.rapid(raised(to, -out));
                cut.rapid(raised(from, out));
                cut.to(frame.out(from), !entry);
                if entry { 0 } else { 10 }
            }
        };
    };
    match rough(&contour, cycle.depth, pockets, steps) {
        Ok(()) => Ok(last),
        Err(message) => fault(at, message),
    }
}
