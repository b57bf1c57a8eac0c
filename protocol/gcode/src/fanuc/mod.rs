//! The dialect of a Fanuc lathe, G-code system A.
//!
//! X is a diameter, U and W are relative, G98 and G99 are the feed a minute and a revolution (ours: G99 until a program
//! says otherwise). A number without a point is taken as it stands, in mm or inches, and said so.

mod corner;
pub(crate) mod cycles;
mod offsets;
mod programs;
mod state;

pub(crate) use programs::{Programs, goes_elsewhere};
pub(crate) use state::{State, names_axes};

use crate::arc;
use crate::block::{Block, Code, mask};
use crate::canon::{Kind, Place, Plane, Sense, Turn};
use crate::execute::{centre_for, feed_of, whole};
use crate::fanuc::state::target;
use crate::finding::{Read, fault};
use crate::machine::{FeedMode, Machine, Sink};

/// Where the program goes on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Next {
    Line,
    /// M98.
    Call {
        program: u32,
        times: u32,
    },
    /// M99.
    Return,
    /// G70 to G73, with the contour in these blocks.
    Contour(cycles::Cycle),
}

/// Sets up the machine as a Fanuc lathe begins.
pub(crate) fn begin(machine: &mut Machine) {
    machine.fanuc = true;
    machine.plane = Plane::Zx;
    machine.diameter = true;
    machine.motion = Some(0);
    machine.feed_mode = FeedMode::PerRevolution;
}

/// The words of a line by what they do.
#[derive(Clone, Copy, Debug, Default)]
struct Words {
    motion: Option<Code>,
    once: Option<Code>,
    units: Option<Code>,
    system: Option<Code>,
    feed_mode: Option<Code>,
    spindle_mode: Option<Code>,
    spindle: Option<Code>,
    coolant: Option<Code>,
    stop: Option<Code>,
    other: Option<Code>,
}

fn sort(machine: &mut Machine, block: &Block, strict: bool) -> Read<Words> {
    let mut words = Words::default();
    for code in block.codes() {
        let Words { motion, once, units, system, feed_mode, spindle_mode, spindle, coolant, stop, other } = &mut words;
        let place = match (code.letter, code.tenths) {
            (b'g', 0 | 10 | 20 | 30 | 900 | 940) => motion,
            (b'g', 40 | 100 | 280 | 500 | 530 | 700 | 710 | 720 | 730 | 740 | 750) => once,
            (b'g', 200 | 210) => units,
            (b'g', 980 | 990) => feed_mode,
            (b'g', 960 | 970) => spindle_mode,
            (b'g', 540 | 550 | 560 | 570 | 580 | 590) => system,
            (b'g', 180 | 400 | 690 | 800) => other,
            (b'g', _) => return refuse(*code),
            (_, 30 | 40 | 50) => spindle,
            (_, 70 | 80 | 90) => coolant,
            (_, 0 | 10 | 20 | 300 | 980 | 990) => stop,
            _ if strict => return fault(code.at, format!("{} is not known", code.name())),
            _ => {
                machine.warn(code.at, format!("{} is not known: it has no effect", code.name()));
                continue;
            }
        };
        if let Some(before) = place.replace(*code)
            && !core::ptr::eq(place, other)
        {
            let (a, b) = (before.name(), code.name());
            return fault(code.at, format!("{a} and {b} exclude one another in a line"));
        }
    }
    Ok(words)
}

#[cold]
fn refuse<T>(code: Code) -> Read<T> {
    let what = match code.tenths {
        320 | 330 | 340 | 760 | 920 => "threads",
        410 | 420 => "the compensation of the tool's nose",
        170 | 190 => "arcs outside of the plane X Z",
        520 | 541 => "further coordinate systems",
        270 | 300 | 310 | 360 | 370 => "reference points and skips",
        650 | 660 | 670 => "macro calls",
        830..=890 => "drilling and tapping cycles",
        _ => return fault(code.at, format!("{} is not known", code.name())),
    };
    fault(code.at, format!("{} is not supported yet: {what}", code.name()))
}

/// Executes a line.
pub(crate) fn execute(
    machine: &mut Machine,
    state: &mut State,
    block: &Block,
    line: &[u8],
    strict: bool,
    sink: Sink<'_>,
) -> Read<Next> {
    for (parameter, value, at) in &block.assignments {
        machine.assign(parameter, *value, *at)?;
    }
    let words = sort(machine, block, strict)?;
    if let Some(letter) = b"yabcvjeh".iter().find(|letter| block.has(**letter)) {
        let word = letter.to_ascii_uppercase() as char;
        return fault(block.at(*letter), format!("the word {word} is not supported"));
    }
    with_points(machine, block, line);
    modes(machine, state, block, &words)?;
    let cuts = words.once.is_none()
        && words.system.is_none()
        && words.motion.map_or(machine.motion, |code| Some(code.tenths)) == Some(10);
    if let (Some((_, _, at)), false) = (block.corner, cuts && block.has_any(const { mask(b"xzuw") })) {
        return fault(at, "a corner (,R or ,C) belongs to a cut by G1");
    }
    let to = corner::end(machine, state, block, cuts, sink)?;
    if let Some(code) = words.system {
        machine.with_offsets(|machine| machine.system = usize::from((code.tenths - 540) / 10));
    }
    m_words(machine, block, &words, sink)?;
    let once = words.once.map(|code| code.tenths);
    if once == Some(500) {
        set_up(machine, state, block)?;
    }
    let mut next = Next::Line;
    match once {
        Some(40) => dwell(machine, block, sink)?,
        Some(100) => offsets::set(machine, block)?,
        Some(280) => home(machine, block, sink)?,
        Some(530) => offsets::go_in_machine(machine, block, &words.motion, sink)?,
        Some(500) => {}
        Some(740 | 750) => cycles::peck(machine, state, block, once == Some(740), sink)?,
        Some(_) => {
            if let Some(cycle) = cycles::of(machine, state, block, words.once)? {
                next = Next::Contour(cycle);
            }
        }
        None => motion(machine, state, block, &words, to, sink)?,
    }
    match words.stop.map(|code| code.tenths) {
        Some(0) => machine.emit(Kind::Stop { optional: false }, sink),
        Some(10) => machine.emit(Kind::Stop { optional: true }, sink),
        Some(20 | 300) => {
            machine.ended = true;
            machine.emit(Kind::End, sink);
        }
        Some(980) => next = call(block)?,
        Some(_) => next = Next::Return,
        None => {}
    }
    Ok(next)
}

/// Says once that a number has no point: on some controls it counts thousandths.
fn with_points(machine: &mut Machine, block: &Block, line: &[u8]) {
    for letter in *b"xzuwik" {
        let Some(value) = block.get(letter).filter(|value| *value != 0.0) else { continue };
        let at = block.at(letter);
        let word = &line[at + 1..];
        let end = word.iter().position(|byte| !matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b' '));
        let word = &word[..end.unwrap_or(word.len())];
        if value.fract() == 0.0 && word.iter().any(u8::is_ascii_digit) && !word.contains(&b'.') {
            machine.warn(at, "a number without a point is taken in whole units, not in thousandths");
        }
    }
}

fn modes(machine: &mut Machine, state: &State, block: &Block, words: &Words) -> Read<()> {
    if let Some(code) = words.units {
        machine.unit = if code.tenths == 200 { 25.4 } else { 1.0 };
    }
    if let Some(code) = words.spindle_mode {
        machine.surface = (code.tenths == 960).then_some(state.most_rpm);
    }
    if let Some(code) = words.feed_mode {
        machine.feed_mode = if code.tenths == 980 { FeedMode::PerMinute } else { FeedMode::PerRevolution };
        machine.feed = 0.0;
    }
    if let Some(feed) = block.get(b'f') {
        if feed < 0.0 {
            return fault(block.at(b'f'), "the feed is negative");
        }
        machine.feed = feed * machine.unit;
    }
    if let Some(speed) = block.get(b's') {
        if speed < 0.0 {
            return fault(block.at(b's'), "the speed of the spindle is negative");
        }
        if words.once.map(|code| code.tenths) != Some(500) {
            machine.speed = speed;
        }
    }
    Ok(())
}

fn m_words(machine: &mut Machine, block: &Block, words: &Words, sink: Sink<'_>) -> Read<()> {
    if let Some(tool) = block.get(b't') {
        let tool = whole(tool, block.at(b't'), "the number of a tool")?;
        // T0101: the tool, then its offset.
        let number = if tool < 100 { tool } else { tool / 100 };
        if number != 0 && number != machine.tool {
            machine.tool = number;
            machine.emit(Kind::Tool(number), sink);
        }
        if tool % 100 != 0 && tool >= 100 {
            machine.warn(block.at(b't'), "the offset of the tool has no effect: there is no table of tools");
        }
    }
    if let Some(code) = words.spindle {
        machine.sense = match code.tenths {
            30 => Sense::Clockwise,
            40 => Sense::Counterclockwise,
            _ => Sense::Off,
        };
    }
    let limit = words.once.map(|code| code.tenths) == Some(500);
    if words.spindle.is_some() || words.spindle_mode.is_some() || (block.has(b's') && !limit) {
        machine.emit(Kind::Spindle { sense: machine.sense, speed: machine.spindle_speed() }, sink);
    }
    if let Some(code) = words.coolant {
        match code.tenths {
            70 => machine.coolant.0 = true,
            80 => machine.coolant.1 = true,
            _ => machine.coolant = (false, false),
        }
        let (mist, flood) = machine.coolant;
        machine.emit(Kind::Coolant { mist, flood }, sink);
    }
    Ok(())
}

/// G50: the most revolutions a minute, or the coordinates of the place where the tool is.
fn set_up(machine: &mut Machine, state: &mut State, block: &Block) -> Read<()> {
    if let Some(most) = block.get(b's') {
        state.most_rpm = Some(most);
        if machine.surface.is_some() {
            machine.surface = Some(state.most_rpm);
        }
    }
    let to = target(machine, block)?.unwrap_or(machine.at);
    let at = machine.at;
    machine.with_offsets(|machine| {
        for axis in [0, 2] {
            machine.shift[axis] += at[axis] - to[axis];
        }
    });
    Ok(())
}

/// G4: X and U are seconds, P milliseconds.
fn dwell(machine: &mut Machine, block: &Block, sink: Sink<'_>) -> Read<()> {
    let seconds = block.get(b'x').or(block.get(b'u')).or(block.get(b'p').map(|ms| ms / 1000.0));
    match seconds {
        Some(seconds) if seconds >= 0.0 => machine.emit(Kind::Dwell { seconds }, sink),
        Some(_) => return fault(0, "the time of G4 is negative"),
        None => return fault(0, "G4 needs X or U (seconds) or P (milliseconds)"),
    }
    Ok(())
}

/// G28: over the place in the line to zero of the machine.
fn home(machine: &mut Machine, block: &Block, sink: Sink<'_>) -> Read<()> {
    let Some(over) = target(machine, block)? else { return fault(0, "G28 needs an axis: U0 W0") };
    machine.go(over, None, 0, sink)?;
    let mut to = over;
    for (axis, letters) in [(0, b"xu"), (2, b"zw")] {
        if block.has_any(mask(letters)) {
            to[axis] = machine.home[0][axis] - machine.offset(axis);
        }
    }
    machine.go(to, None, 0, sink)
}

/// M98: `P1234 L3`, or `P00031234`.
fn call(block: &Block) -> Read<Next> {
    let Some(program) = block.get(b'p') else { return fault(0, "M98 needs a P word: the number of a program") };
    let at = block.at(b'p');
    let program = whole(program, at, "the number of a program")?;
    let times = match block.get(b'l') {
        Some(times) => whole(times, block.at(b'l'), "L of M98")?,
        None => (program / 10_000).max(1),
    };
    if times > 9999 {
        return fault(at, "M98 calls at most 9999 times");
    }
    Ok(Next::Call { program: program % 10_000, times })
}

/// `to` is where the motion ends, if a corner before it has asked for that.
fn motion(
    machine: &mut Machine,
    state: &mut State,
    block: &Block,
    words: &Words,
    to: Option<[f64; 4]>,
    sink: Sink<'_>,
) -> Read<()> {
    if let Some(code) = words.motion {
        machine.motion = Some(code.tenths);
        (state.box_to, state.box_taper) = ([None; 2], 0.0);
    }
    let calls = words.stop.is_some_and(|code| matches!(code.tenths, 980 | 990));
    let unused = match machine.motion {
        Some(20 | 30) => &b"pqd"[..],
        Some(900 | 940) => b"ikpqd",
        _ => b"rikpqd",
    };
    if let Some(letter) = unused.iter().find(|letter| block.has(**letter) && !(calls && **letter == b'p')) {
        let word = letter.to_ascii_uppercase() as char;
        return fault(block.at(*letter), format!("nothing in the line uses the {word} word"));
    }
    let code = machine.motion;
    let at = b"xzuw".iter().find(|letter| block.has(**letter)).map_or(0, |letter| block.at(*letter));
    let Some(to) = to.map_or_else(|| target(machine, block), |to| Ok(Some(to)))? else {
        return match code {
            Some(20 | 30) if block.has_any(const { mask(b"ikr") }) => {
                cut_arc(machine, block, machine.at, code == Some(20), sink)
            }
            _ => Ok(()),
        };
    };
    match code {
        Some(0) => machine.go(to, None, at, sink),
        Some(10) => {
            let feed = feed_of(machine, block, || 0.0, at)?;
            match block.corner {
                Some(corner) => corner::begin(machine, state, to, feed, corner),
                None => machine.go(to, Some(feed), at, sink),
            }
        }
        Some(20 | 30) => cut_arc(machine, block, to, code == Some(20), sink),
        _ => cut_box(machine, state, block, to, code == Some(900), sink),
    }?;
    if [b"xu", b"zw"].iter().all(|letters| block.has_any(mask(*letters))) && block.has(b'x') && block.has(b'z') {
        machine.lost = false;
    }
    Ok(())
}

/// G2 and G3 in the plane X Z: R, or I and K from the start; all radii.
fn cut_arc(machine: &mut Machine, block: &Block, to: [f64; 4], clockwise: bool, sink: Sink<'_>) -> Read<()> {
    let turn = if clockwise { Turn::Clockwise } else { Turn::Counterclockwise };
    let at = b"rikxzuw".iter().find(|letter| block.has(**letter)).map_or(0, |letter| block.at(*letter));
    let (from, end) = ([machine.at[2], machine.at[0]], [to[2], to[0]]);
    let offset = |letter| block.get(letter).map(|value| value * machine.unit);
    let centre = match (offset(b'r'), offset(b'k'), offset(b'i')) {
        (Some(_), None, None) if from == end => Err("an arc with R cannot end where it starts".to_owned()),
        (Some(radius), None, None) => arc::centre(from, end, radius, turn),
        (Some(_), _, _) => return fault(at, "an arc has R or I, K, not both"),
        (None, None, None) => return fault(at, "an arc needs R, or I, K"),
        (None, k, i) => {
            let centre = [from[0] + k.unwrap_or(0.0), from[1] + i.unwrap_or(0.0)];
            arc::check(from, end, centre, machine.unit != 1.0).map(|()| centre)
        }
    };
    let Some(centre) = centre_for(machine, to, centre, at)? else { return Ok(()) };
    let feed = feed_of(machine, block, || 0.0, at)?;
    let kind = Kind::Arc {
        to: Place::of(machine.in_machine(to)),
        plane: Plane::Zx,
        centre: [centre[0] + machine.offset(2), centre[1] + machine.offset(0)],
        turn,
        turns: 1,
        feed,
    };
    machine.at = to;
    machine.emit(kind, sink);
    Ok(())
}

/// G90 and G94: there, along, out and back, from where the tool is.
fn cut_box(
    machine: &mut Machine,
    state: &mut State,
    block: &Block,
    to: [f64; 4],
    along: bool,
    sink: Sink<'_>,
) -> Read<()> {
    for (place, (axis, letters)) in state.box_to.iter_mut().zip([(0, b"xu"), (2, b"zw")]) {
        if block.has_any(mask(letters)) {
            *place = Some(to[axis]);
        }
    }
    if let Some(taper) = block.get(b'r') {
        state.box_taper = taper * machine.unit;
    }
    let [Some(x), Some(z)] = state.box_to else {
        return fault(0, "G90 and G94 need both axes in their first line");
    };
    let start = machine.at;
    let feed = Some(feed_of(machine, block, || 0.0, 0)?);
    let place = |x: f64, z: f64| [x, start[1], z, start[3]];
    let (first, second, third) = if along {
        (place(x + state.box_taper, start[2]), place(x, z), place(start[0], z))
    } else {
        (place(start[0], z + state.box_taper), place(x, z), place(x, start[2]))
    };
    machine.go(first, None, 0, sink)?;
    machine.go(second, feed, 0, sink)?;
    machine.go(third, feed, 0, sink)?;
    machine.go(start, None, 0, sink)
}
