//! What a line of LinuxCNC's dialect does, word by word, in the order in which LinuxCNC does it.

use crate::arc;
use crate::block::{Block, mask};
use crate::canon::{Feed, Kind, Plane, Sense, Turn};
use crate::codes::{Codes, Group, MGroup, is_cycle};
use crate::finding::{Read, fault};
use crate::machine::{AXES, FeedMode, Machine, Sink};

/// Executes a line, but for a cycle, whose word it returns, in tenths.
pub(crate) fn execute(machine: &mut Machine, block: &Block, strict: bool, sink: Sink<'_>) -> Read<Option<u16>> {
    let codes = Codes::of(block)?;
    if let Some(code) = codes.unknown {
        if strict {
            return fault(code.at, format!("{} is not known", code.name()));
        }
        machine.warn(code.at, format!("{} is not known: it has no effect", code.name()));
    }
    let motion = motion_of(machine, block, &codes)?;
    are_used(block, &codes, motion)?;
    modes_before(machine, block, &codes)?;
    m_words(machine, block, &codes, sink)?;
    g_words(machine, block, &codes, sink)?;
    if let Some(motion) = motion {
        match motion {
            800 => machine.motion = None,
            code if is_cycle(code) => {
                if codes.m(MGroup::Stop).is_some() {
                    return fault(0, "a line with a cycle neither stops nor ends the program");
                }
                return Ok(Some(code));
            }
            code => {
                let absolute_machine = codes.g(Group::Once) == Some(530);
                move_by(machine, block, code, absolute_machine, sink)?;
            }
        }
    }
    stop(machine, &codes, sink);
    Ok(None)
}

/// The motion that a line makes, as far as its words say so.
#[inline]
fn motion_of(machine: &Machine, block: &Block, codes: &Codes) -> Read<Option<u16>> {
    if let Some(letter) = b"bcuvw".iter().find(|letter| block.has(**letter)) {
        let axis = letter.to_ascii_uppercase() as char;
        return fault(block.at(*letter), format!("the axis {axis} is not supported"));
    }
    let (once, motion) = (codes.g(Group::Once), codes.g(Group::Motion));
    let axes = Machine::has_axis(block);
    let takes_axes = matches!(once, Some(100 | 280 | 300 | 520 | 920));
    let of = |letters: &[u8]| letters.iter().find(|letter| block.has(**letter)).map_or(0, |letter| block.at(*letter));
    match motion {
        Some(800) if axes && !takes_axes => return fault(of(&AXES), "G80 takes no axes"),
        Some(800) => {}
        Some(_) if takes_axes => return fault(of(&AXES), "the line has two G words that take axes"),
        _ => {}
    }
    if matches!(once, Some(520 | 920)) && !axes {
        return fault(0, "G52 and G92 need an axis");
    }
    if once == Some(530) {
        let code = motion.or(machine.motion);
        if !matches!(code, Some(0 | 10)) {
            return fault(0, "G53 goes with G0 or G1");
        }
        let relative = codes.g(Group::Distance).map_or(!machine.absolute, |code| code == 910);
        if relative {
            return fault(0, "G53 goes with absolute coordinates (G90)");
        }
    }
    if motion.is_some() || takes_axes {
        return Ok(motion);
    }
    if axes {
        if codes.g(Group::Length) == Some(431) {
            return Ok(None);
        }
        return match machine.motion {
            Some(code) => Ok(Some(code)),
            None => fault(of(&AXES), "there is an axis, and no motion (G0 to G3) is in effect"),
        };
    }
    let arcs = matches!(machine.motion, Some(20 | 30));
    Ok(machine.motion.filter(|_| arcs && block.has_any(const { mask(b"ijk") })))
}

/// Refuses a word that no other word of its line uses.
#[inline]
fn are_used(block: &Block, codes: &Codes, motion: Option<u16>) -> Read<()> {
    if !block.has_any(const { mask(b"ijkpqrldeh") }) || motion.is_some_and(is_cycle) {
        return Ok(());
    }
    let once = codes.g(Group::Once);
    let arc = matches!(motion, Some(20 | 30));
    let offsets = once == Some(100);
    let path = codes.g(Group::Path) == Some(640);
    let overrides = codes.m(MGroup::Override).is_some();
    let uses = |letter: u8| match letter {
        b'i' | b'j' | b'k' => arc,
        b'p' => arc || offsets || path || once == Some(40) || overrides,
        b'q' => path || offsets || codes.m(MGroup::Tool) == Some(610),
        b'r' => arc || offsets,
        b'l' => offsets,
        b'd' => codes.g(Group::SpindleMode) == Some(960),
        b'h' => codes.g(Group::Length) == Some(430),
        _ => false,
    };
    match b"ijkpqrldeh".iter().find(|letter| block.has(**letter) && !uses(**letter)) {
        Some(letter) => {
            let word = letter.to_ascii_uppercase() as char;
            fault(block.at(*letter), format!("nothing in the line uses the {word} word"))
        }
        None => Ok(()),
    }
}

/// Spindle mode, feed mode, F, S, T.
#[inline]
fn modes_before(machine: &mut Machine, block: &Block, codes: &Codes) -> Read<()> {
    match codes.g(Group::SpindleMode) {
        Some(970) => machine.surface = None,
        Some(_) => {
            if !block.has(b's') {
                return fault(0, "G96 needs an S word");
            }
            machine.surface = Some(block.get(b'd').map(f64::abs));
        }
        None => {}
    }
    if let Some(code) = codes.g(Group::FeedMode) {
        machine.feed_mode = match code {
            930 => FeedMode::InverseTime,
            940 => FeedMode::PerMinute,
            _ => FeedMode::PerRevolution,
        };
        // A number in another unit is no feed.
        machine.feed = 0.0;
    }
    if let Some(feed) = block.get(b'f') {
        if feed < 0.0 {
            return fault(block.at(b'f'), "the feed is negative");
        }
        if machine.feed_mode != FeedMode::InverseTime {
            machine.feed = feed * machine.unit;
        }
    }
    if let Some(speed) = block.get(b's') {
        if speed < 0.0 {
            return fault(block.at(b's'), "the speed of the spindle is negative");
        }
        machine.speed = speed;
    }
    if let Some(tool) = block.get(b't') {
        machine.selected_tool = whole(tool, block.at(b't'), "the number of a tool")?;
    }
    Ok(())
}

pub(crate) fn whole(value: f64, at: usize, what: &str) -> Read<u32> {
    let number = libm::round(value);
    if (value - number).abs() > 1e-4 || !(0.0..=1e9).contains(&number) {
        return fault(at, format!("{what} is a whole number, 0 or more; it is {value}"));
    }
    Ok(number as u32)
}

#[inline]
fn m_words(machine: &mut Machine, block: &Block, codes: &Codes, sink: Sink<'_>) -> Read<()> {
    match codes.m(MGroup::Tool) {
        Some(60) => {
            machine.tool = machine.selected_tool;
            // A tool is changed at rest.
            if machine.sense != Sense::Off {
                machine.sense = Sense::Off;
                machine.emit(Kind::Spindle { sense: Sense::Off, speed: machine.spindle_speed() }, sink);
            }
            machine.emit(Kind::Tool(machine.tool), sink);
        }
        Some(_) => {
            let Some(tool) = block.get(b'q') else { return fault(0, "M61 needs a Q word") };
            machine.tool = whole(tool, block.at(b'q'), "the number of a tool")?;
            machine.emit(Kind::Tool(machine.tool), sink);
        }
        None => {}
    }
    let spindle = codes.m(MGroup::Spindle);
    if let Some(code) = spindle {
        machine.sense = match code {
            30 => Sense::Clockwise,
            40 => Sense::Counterclockwise,
            _ => Sense::Off,
        };
    }
    if spindle.is_some() || block.has(b's') || codes.g(Group::SpindleMode).is_some() {
        let speed = machine.spindle_speed();
        machine.emit(Kind::Spindle { sense: machine.sense, speed }, sink);
    }
    if let Some(code) = codes.m(MGroup::Coolant) {
        let (mist, flood) = &mut machine.coolant;
        match code {
            70 => *mist = true,
            80 => *flood = true,
            _ => (*mist, *flood) = (false, false),
        }
        let (mist, flood) = machine.coolant;
        machine.emit(Kind::Coolant { mist, flood }, sink);
    }
    Ok(())
}

#[inline]
fn g_words(machine: &mut Machine, block: &Block, codes: &Codes, sink: Sink<'_>) -> Read<()> {
    let once = codes.g(Group::Once);
    if once == Some(40) {
        match block.get(b'p') {
            Some(seconds) if seconds >= 0.0 => machine.emit(Kind::Dwell { seconds }, sink),
            Some(_) => return fault(block.at(b'p'), "the time of G4 is negative"),
            None => return fault(0, "G4 needs a P word: seconds"),
        }
    }
    if let Some(code) = codes.g(Group::Plane) {
        machine.plane = match code {
            170 => Plane::Xy,
            180 => Plane::Zx,
            _ => Plane::Yz,
        };
        machine.emit(Kind::Plane(machine.plane), sink);
    }
    if let Some(code) = codes.g(Group::Units) {
        machine.unit = if code == 200 { 25.4 } else { 1.0 };
    }
    if let Some(code) = codes.g(Group::Diameter) {
        machine.diameter = code == 70;
    }
    match codes.g(Group::Length) {
        Some(490) => machine.with_offsets(|machine| machine.tool_offset = [0.0; 4]),
        Some(431) => {
            let given: [Option<f64>; 4] = core::array::from_fn(|axis| machine.axis_word(block, axis));
            machine.with_offsets(|machine| {
                for (offset, given) in machine.tool_offset.iter_mut().zip(given) {
                    *offset = given.unwrap_or(*offset);
                }
            });
        }
        Some(_) => machine.warn(0, "G43 has no effect: there is no table of tools"),
        None => {}
    }
    if let Some(code) = codes.g(Group::System) {
        let system = if code > 590 { code - 585 } else { (code - 540) / 10 };
        machine.with_offsets(|machine| machine.system = usize::from(system));
    }
    if let Some(code) = codes.g(Group::Distance) {
        machine.absolute = code == 900;
    }
    if let Some(code) = codes.g(Group::ArcDistance) {
        machine.arc_absolute = code == 901;
    }
    match once {
        Some(100) => set_up(machine, block)?,
        Some(280) => home(machine, block, 0, sink)?,
        Some(300) => home(machine, block, 1, sink)?,
        Some(281) => machine.home[0] = machine.in_machine(machine.at),
        Some(301) => machine.home[1] = machine.in_machine(machine.at),
        Some(520 | 920..=923) => shift(machine, block, once),
        _ => {}
    }
    Ok(())
}

/// G10.
fn set_up(machine: &mut Machine, block: &Block) -> Read<()> {
    let what = block.get(b'l').unwrap_or(-1.0);
    let here = what == 20.0;
    if [0.0, 1.0, 10.0, 11.0].contains(&what) {
        return fault(block.at(b'l'), format!("G10 L{what} is not supported yet: there is no table of tools"));
    }
    if what != 2.0 && !here {
        return fault(block.at(b'l'), "G10 needs L2 or L20");
    }
    if block.has_any(const { mask(b"ijq") }) {
        return fault(0, "G10 L2 and G10 L20 take no I, J and Q words");
    }
    if block.has(b'r') {
        return fault(block.at(b'r'), "G10 with R is not supported yet: a rotated coordinate system");
    }
    let Some(number) = block.get(b'p') else { return fault(0, "G10 needs a P word: 0 to 9") };
    let number = whole(number, block.at(b'p'), "P of G10")? as usize;
    if number > 9 {
        return fault(block.at(b'p'), "P of G10 is 0 to 9");
    }
    let system = if number == 0 { machine.system } else { number - 1 };
    let given: [Option<f64>; 4] = core::array::from_fn(|axis| machine.axis_word(block, axis));
    let there = machine.in_machine(machine.at);
    machine.with_offsets(|machine| {
        for (axis, value) in (0..).zip(given) {
            let Some(value) = value else { continue };
            let from = there[axis] - machine.shift[axis] - machine.tool_offset[axis];
            machine.systems[system][axis] = if here { from - value } else { value };
        }
    });
    Ok(())
}

/// G28 and G30: over the place in the line to the place that is stored.
fn home(machine: &mut Machine, block: &Block, which: usize, sink: Sink<'_>) -> Read<()> {
    let over = end_of(machine, block, false);
    machine.go(over, None, 0, sink)?;
    let home = machine.home[which];
    let all = !Machine::has_axis(block);
    let to =
        core::array::from_fn(
            |axis| {
                if all || block.has(AXES[axis]) { home[axis] - machine.offset(axis) } else { over[axis] }
            },
        );
    machine.go(to, None, 0, sink)?;
    machine.lost = false;
    Ok(())
}

/// G52 and G92 to G92.3.
fn shift(machine: &mut Machine, block: &Block, code: Option<u16>) {
    let given: [Option<f64>; 4] = core::array::from_fn(|axis| machine.axis_word(block, axis));
    let at = machine.at;
    machine.shifted = !matches!(code, Some(921 | 922));
    machine.with_offsets(|machine| {
        match code {
            Some(921 | 922) => machine.shift = [0.0; 4],
            Some(923) => machine.shift = machine.saved_shift,
            _ => {
                for (axis, value) in (0..).zip(given) {
                    let Some(value) = value else { continue };
                    machine.shift[axis] =
                        if code == Some(520) { value } else { at[axis] + machine.shift[axis] - value };
                }
                machine.saved_shift = machine.shift;
            }
        }
        if code == Some(921) {
            machine.saved_shift = [0.0; 4];
        }
    });
}

/// Where a line ends, in the program's coordinates.
#[inline]
fn end_of(machine: &Machine, block: &Block, of_machine: bool) -> [f64; 4] {
    let mut to = machine.at;
    for (axis, place) in to.iter_mut().enumerate() {
        match machine.axis_word(block, axis) {
            None => {}
            Some(value) if of_machine => *place = value - machine.offset(axis),
            Some(value) if machine.absolute => *place = value,
            Some(value) => *place += value,
        }
    }
    to
}

#[inline]
fn move_by(machine: &mut Machine, block: &Block, code: u16, of_machine: bool, sink: Sink<'_>) -> Read<()> {
    machine.motion = Some(code);
    let to = end_of(machine, block, of_machine);
    if code >= 20 {
        let turn = if code == 20 { Turn::Clockwise } else { Turn::Counterclockwise };
        return turn_by(machine, block, turn, to, sink);
    }
    let at = AXES.iter().find(|axis| block.has(**axis)).map_or(0, |axis| block.at(*axis));
    let feed = if code == 0 {
        None
    } else {
        let path = || {
            let path: [f64; 4] = core::array::from_fn(|axis| to[axis] - machine.at[axis]);
            let straight = libm::sqrt(path[..3].iter().map(|way| way * way).sum());
            if straight > 0.0 { straight } else { path[3].abs() }
        };
        Some(feed_of(machine, block, path, at)?)
    };
    machine.go(to, feed, at, sink)?;
    let [first, second, _] = machine.plane.axes();
    if machine.absolute && [first, second].iter().all(|axis| block.has(AXES[*axis])) {
        machine.lost = false;
    }
    Ok(())
}

/// The centre that has been found for an arc to `to`, if that lies within reach; None if it follows from an error that
/// has been told, so that the machine takes itself to be there.
pub(crate) fn centre_for(
    machine: &mut Machine,
    to: [f64; 4],
    found: Result<[f64; 2], String>,
    at: usize,
) -> Read<Option<[f64; 2]>> {
    match found {
        Ok(centre) if Machine::is_near(&centre) && Machine::is_near(&machine.in_machine(to)) => Ok(Some(centre)),
        Ok(_) => fault(at, "the arc is too far from zero"),
        Err(_) if machine.lost => {
            machine.at = to;
            Ok(None)
        }
        Err(message) => fault(at, message),
    }
}

/// The feed of a cut of this length.
#[inline]
pub(crate) fn feed_of(machine: &Machine, block: &Block, length: impl FnOnce() -> f64, at: usize) -> Read<Feed> {
    match machine.feed_mode {
        FeedMode::InverseTime => match block.get(b'f') {
            // As in LinuxCNC, the least feed is 0.1 units a minute.
            Some(often) => Ok(Feed::PerMinute((length() * often).max(0.1 * machine.unit))),
            None => fault(at, "each cut in G93 needs an F word"),
        },
        _ if machine.feed == 0.0 => fault(at, "a cut needs a feed: there is no F word, or it is 0"),
        FeedMode::PerMinute => Ok(Feed::PerMinute(machine.feed)),
        FeedMode::PerRevolution if machine.speed == 0.0 => {
            fault(at, "a cut in G95 needs a spindle that turns: there is no S word, or it is 0")
        }
        FeedMode::PerRevolution => Ok(Feed::PerRevolution(machine.feed)),
    }
}

/// G2 and G3.
fn turn_by(machine: &mut Machine, block: &Block, turn: Turn, to: [f64; 4], sink: Sink<'_>) -> Read<()> {
    let [first, second, across] = machine.plane.axes();
    let letter = |axis: usize| b'i' + axis as u8;
    let place =
        |letters: &[u8]| letters.iter().find(|letter| block.has(**letter)).map_or(0, |letter| block.at(*letter));
    let at = place(b"ijkrxyz");
    let lathe = if machine.plane == Plane::Xy { ": a lathe's program selects the plane X Z by G18" } else { "" };
    let from = [machine.at[first], machine.at[second]];
    let end = [to[first], to[second]];
    let turns = match block.get(b'p') {
        Some(turns) => whole(turns, block.at(b'p'), "P of an arc")?,
        None => 1,
    };
    if turns == 0 {
        return fault(block.at(b'p'), "P of an arc is 1 or more");
    }
    let centre = match block.get(b'r') {
        Some(_) if block.has_any(const { mask(b"ijk") }) => {
            return fault(block.at(b'r'), "an arc has R or I, J, K, not both");
        }
        Some(radius) => {
            if ![first, second].iter().any(|axis| block.has(AXES[*axis])) {
                return fault(at, format!("an arc with R needs an axis of its plane{lathe}"));
            }
            arc::centre(from, end, radius * machine.unit, turn)
        }
        None if !block.has_any(const { mask(b"ijk") }) => return fault(at, "an arc needs R, or I, J, K"),
        None => {
            if block.has(letter(across)) {
                let word = letter(across).to_ascii_uppercase() as char;
                return fault(block.at(letter(across)), format!("{word} is across the plane of the arc{lathe}"));
            }
            let mut centre = [0.0; 2];
            for (centre, (axis, from)) in centre.iter_mut().zip([(first, from[0]), (second, from[1])]) {
                let given = block.get(letter(axis)).map(|value| value * machine.unit);
                *centre = match given {
                    Some(value) if machine.arc_absolute => value,
                    None if machine.arc_absolute => return fault(at, "G90.1 needs both words of the centre"),
                    value => from + value.unwrap_or(0.0),
                };
            }
            arc::check(from, end, centre, machine.unit != 1.0).map(|()| centre)
        }
    };
    let Some(centre) = centre_for(machine, to, centre, at)? else { return Ok(()) };
    let path = || {
        let round = arc::length(from, end, centre, turn, turns);
        libm::hypot(round, to[across] - machine.at[across])
    };
    let feed = feed_of(machine, block, path, at)?;
    let kind = Kind::Arc {
        to: crate::canon::Place::of(machine.in_machine(to)),
        plane: machine.plane,
        centre: [centre[0] + machine.offset(first), centre[1] + machine.offset(second)],
        turn,
        turns,
        feed,
    };
    machine.at = to;
    machine.emit(kind, sink);
    Ok(())
}

/// M0, M1, M2, M30, M60.
#[inline]
fn stop(machine: &mut Machine, codes: &Codes, sink: Sink<'_>) {
    match codes.m(MGroup::Stop) {
        Some(0 | 600) => machine.emit(Kind::Stop { optional: false }, sink),
        Some(10) => machine.emit(Kind::Stop { optional: true }, sink),
        Some(_) => {
            machine.ended = true;
            machine.emit(Kind::End, sink);
        }
        None => {}
    }
}
