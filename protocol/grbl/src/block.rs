//! A block of G-code: what is wrong with it, in the firmware's order, or what it does.

use std::collections::VecDeque;

use crate::arc::{self, Arc};
use crate::axes::{A, Axes, LETTERS, MOST, X, Z};
use crate::code::Code;
use crate::memory::{Memory, SYSTEMS};
use crate::modal::{FeedMode, Modal, Motion, Spindle};
use crate::number;
use crate::path::{Rate, Straight};
use crate::steps::Step;
use crate::words::{AxisCommand, Flow, Once, Words};

const MM_PER_INCH: f32 = 25.4;
const M_PER_FOOT: f32 = 0.3048;
/// Constant surface speed is followed where the spindle is off by more than this share.
const OFF: f32 = 0.05;
/// The largest number of a line.
const LINE_MOST: i32 = 10_000_000;
/// G10: as L words.
const L_ORIGIN: u8 = 2;
const L_PLACE: u8 = 20;

/// What a machine can do. Where it cannot, torno answers with the firmware's code that comes nearest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Abilities {
    /// Which axes can move. A motion of another one is refused with `error:33`.
    pub axes: Axes<bool>,
    /// Whether the spindle can turn both ways. If not, M4 is refused with `error:20`.
    pub counterclockwise: bool,
    /// Whether `$HX` looks for the end of one axis: an option of the firmware's build. If not, it is `error:3`.
    pub single_homing: bool,
    /// Whether a hold takes seconds. A `~` that comes before the machine stands is remembered then; the firmware,
    /// where it takes milliseconds, forgets it.
    pub holds_slowly: bool,
}

/// What a block is read with.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) modal: &'a Modal,
    pub(crate) memory: &'a Memory,
    pub(crate) abilities: &'a Abilities,
}

/// A block without faults.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    pub(crate) steps: VecDeque<Step>,
    /// What is in force when all of them are done.
    pub(crate) modal: Modal,
}

/// Reads a block; the words of a jog, if it is one. The first fault counts.
pub(crate) fn read(text: &[u8], is_jog: bool, context: Context<'_>) -> Result<Block, Code> {
    let mut words = Words::read(text, &context.memory.settings)?;
    if is_jog {
        words.motion = words.motion.or(Some(Motion::Linear));
        words.feed_mode = words.feed_mode.or(Some(FeedMode::PerMinute));
    }
    let mut reader = Reader::new(words, is_jog, context);
    let checked = reader.check()?;
    Ok(if is_jog { reader.jog(&checked)? } else { reader.block(&checked) })
}

struct Reader<'a> {
    words: Words,
    is_jog: bool,
    before: &'a Modal,
    memory: &'a Memory,
    abilities: &'a Abilities,
    /// What is in force with the block's own words.
    now: Modal,
    /// What wants the axis words.
    axis_command: Option<AxisCommand>,
}

/// What the checks have found out.
struct Checked {
    /// Where the axis words point, in machine coordinates.
    target: Axes,
    /// G10: the coordinate system and its origin.
    system: (usize, Axes),
    /// From the start of an arc to its centre.
    offset: [f32; 2],
}

impl<'a> Reader<'a> {
    fn new(words: Words, is_jog: bool, Context { modal: before, memory, abilities }: Context<'a>) -> Self {
        let mut now = before.clone();
        now.motion = words.motion.unwrap_or(now.motion);
        now.plane = words.plane.unwrap_or(now.plane);
        now.inches = words.inches.unwrap_or(now.inches);
        now.incremental = words.incremental.unwrap_or(now.incremental);
        now.feed_mode = words.feed_mode.unwrap_or(now.feed_mode);
        now.diameter = words.diameter.unwrap_or(now.diameter);
        now.surface = words.surface.unwrap_or(now.surface);
        now.system = words.system.unwrap_or(now.system);
        now.spindle = words.spindle.unwrap_or(now.spindle);
        now.flood = words.flood.unwrap_or(now.flood);
        now.speed = match (before.surface, now.surface) {
            _ if words.has(b'S') && now.surface && now.inches => words.s * M_PER_FOOT,
            _ if words.has(b'S') => words.s,
            // It goes on as it turns.
            (true, false) => before.rpm,
            _ => before.speed,
        };
        if words.surface.is_some() {
            now.most_rpm = words.d;
        }
        // A T word counts for its block only.
        now.tool = words.t;
        let axis_command = words.axis_command.or(words.has_axes().then_some(AxisCommand::Motion));
        Self { words, is_jog, before, memory, abilities, now, axis_command }
    }

    fn length(&self, value: f32) -> f32 {
        if self.now.inches { value * MM_PER_INCH } else { value }
    }

    /// The word of an axis: mm, of X a radius, of A degrees.
    fn axis_value(&self, axis: usize) -> f32 {
        let value = self.words.axis_values[axis];
        match axis {
            A => value,
            X if self.now.diameter => self.length(value) / 2.0,
            _ => self.length(value),
        }
    }

    fn check(&mut self) -> Result<Checked, Code> {
        if self.words.has(b'N') && self.words.n > LINE_MOST {
            return Err(Code::InvalidLineNumber);
        }
        if self.now.spindle == Spindle::Counterclockwise && !self.abilities.counterclockwise {
            return Err(Code::UnsupportedCommand);
        }
        if self.words.surface == Some(true) {
            if !self.words.has(b'S') {
                return Err(Code::ValueMissing);
            }
            self.words.used(b"D");
        }
        self.now.feed = self.feed()?;
        if self.words.once == Some(Once::Dwell) {
            if !self.words.has(b'P') {
                return Err(Code::ValueMissing);
            }
            self.words.used(b"P");
        }
        if self.words.tool_length == Some(true) && !self.words.named_axes().eq([Z]) {
            return Err(Code::ToolLengthAxis);
        }
        let mut checked = Checked { target: self.before.position, system: (0, [0.0; MOST]), offset: [0.0; 2] };
        match self.words.once {
            Some(Once::SetSystem) => checked.system = self.system()?,
            Some(Once::Shift) if !self.words.has_axes() => return Err(Code::NoAxisWords),
            Some(Once::Shift) => self.now.shift = self.shift(),
            _ => checked.target = self.target()?,
        }
        if self.now.motion == Motion::None {
            if self.words.has_axes() {
                return Err(Code::AxisWordsExist);
            }
        } else if self.axis_command == Some(AxisCommand::Motion) {
            checked.offset = self.motion(checked.target)?;
        }
        self.words.used(if self.is_jog { b"NF" } else { b"NFST" });
        if self.axis_command.is_some() {
            self.words.used(&LETTERS);
        }
        if self.words.has_unused() {
            return Err(Code::UnusedWords);
        }
        Ok(checked)
    }

    /// The feed rate of the block; 0 if there is none.
    fn feed(&self) -> Result<f32, Code> {
        let given = self.words.has(b'F');
        if self.is_jog {
            return if given { Ok(self.length(self.words.f)) } else { Err(Code::UndefinedFeed) };
        }
        if self.now.feed_mode == FeedMode::InverseTime {
            let moves = !matches!(self.now.motion, Motion::None | Motion::Rapid);
            if self.axis_command == Some(AxisCommand::Motion) && moves && !given {
                return Err(Code::UndefinedFeed);
            }
            return Ok(self.words.f);
        }
        Ok(match self.before.feed_mode {
            FeedMode::InverseTime => self.words.f,
            _ if given => self.length(self.words.f),
            // In another mode there is none until one is given.
            mode => {
                if mode == self.now.feed_mode {
                    self.before.feed
                } else {
                    0.0
                }
            }
        })
    }

    /// G10: which coordinate system, and its origin.
    fn system(&mut self) -> Result<(usize, Axes), Code> {
        if !self.words.has_axes() {
            return Err(Code::NoAxisWords);
        }
        if !self.words.has(b'P') && !self.words.has(b'L') {
            return Err(Code::ValueMissing);
        }
        // What does not fit into a byte is cut off.
        let number = number::unsigned(self.words.p) as u8;
        if usize::from(number) > SYSTEMS {
            return Err(Code::UnsupportedSystem);
        }
        let relative = match self.words.l {
            L_PLACE => true,
            L_ORIGIN if !self.words.has(b'R') => false,
            _ => return Err(Code::UnsupportedCommand),
        };
        self.words.used(b"LP");
        let system = match number {
            0 => self.now.system,
            number => usize::from(number) - 1,
        };
        let mut origin = self.memory.systems[system];
        for axis in self.words.named_axes() {
            origin[axis] =
                if relative { self.origin_for(axis, self.before.shift[axis]) } else { self.axis_value(axis) };
        }
        Ok((system, origin))
    }

    /// What has to be added to `other` so that the axis's word is the present place.
    fn origin_for(&self, axis: usize, other: f32) -> f32 {
        let lengthened = if axis == Z { self.before.tool_length } else { 0.0 };
        self.before.position[axis] - other - self.axis_value(axis) - lengthened
    }

    /// G92: the shift that makes the words the present place.
    fn shift(&self) -> Axes {
        let mut shift = self.before.shift;
        for axis in self.words.named_axes() {
            shift[axis] = self.origin_for(axis, self.memory.systems[self.now.system][axis]);
        }
        shift
    }

    /// Where the axis words point, in machine coordinates.
    fn target(&mut self) -> Result<Axes, Code> {
        let mut target = self.before.position;
        if self.axis_command != Some(AxisCommand::ToolLength) {
            let origin = self.now.origin(&self.memory.systems);
            for axis in self.words.named_axes() {
                let value = self.axis_value(axis);
                target[axis] = match (self.words.once, self.now.incremental) {
                    (Some(Once::Machine), _) => value,
                    (_, false) => value + origin[axis],
                    (_, true) => value + self.before.position[axis],
                };
            }
        }
        match self.words.once {
            // Without axis words there is no place on the way.
            Some(Once::GoHome(_)) if !self.words.has_axes() => self.axis_command = None,
            Some(Once::GoHome(_)) => self.check_axes(target)?,
            Some(Once::Machine) if !matches!(self.now.motion, Motion::Rapid | Motion::Linear) => {
                return Err(Code::G53Motion);
            }
            _ => {}
        }
        Ok(target)
    }

    /// Checks what a motion needs. For an arc, gives what lies between its start and its centre.
    fn motion(&mut self, target: Axes) -> Result<[f32; 2], Code> {
        let has_axes = self.words.has_axes();
        let stands = self.now.spindle == Spindle::Off || self.now.speed == 0.0;
        let no_feed = self.now.feed == 0.0 || (self.now.feed_mode == FeedMode::PerTurn && stands && !self.is_jog);
        if self.now.motion != Motion::Rapid && no_feed {
            return Err(Code::UndefinedFeed);
        }
        let mut offset = [0.0; 2];
        match self.now.motion {
            // Without axis words they only come into force.
            Motion::Rapid | Motion::Linear if !has_axes => self.axis_command = None,
            Motion::Rapid | Motion::Linear | Motion::None => {}
            Motion::Arc { clockwise } => offset = self.arc(target, clockwise)?,
            Motion::Probe(_) if !has_axes => return Err(Code::NoAxisWords),
            Motion::Probe(_) if target == self.before.position => return Err(Code::InvalidTarget),
            Motion::Probe(_) => {}
        }
        self.check_axes(target)?;
        Ok(offset)
    }

    /// Whether the machine can go there.
    fn check_axes(&self, target: Axes) -> Result<(), Code> {
        let fixed = (0..MOST).filter(|axis| !self.abilities.axes[*axis]);
        let mut moved = fixed.filter(|axis| target[*axis] != self.before.position[*axis]);
        moved.next().map_or(Ok(()), |_| Err(Code::InvalidTarget))
    }

    fn arc(&mut self, target: Axes, clockwise: bool) -> Result<[f32; 2], Code> {
        let [a, b] = self.now.plane_axes();
        if !self.words.has_axes() {
            return Err(Code::NoAxisWords);
        }
        if !self.words.has_axis(a) && !self.words.has_axis(b) {
            return Err(Code::NoAxisWordsInPlane);
        }
        let chord = [a, b].map(|axis| target[axis] - self.before.position[axis]);
        let offset = if self.words.has(b'R') {
            self.words.used(b"R");
            if target == self.before.position {
                return Err(Code::InvalidTarget);
            }
            arc::offset(chord, self.length(self.words.r), clockwise)?
        } else {
            let given = |axis: usize| self.words.has(b'I' + axis as u8);
            if !given(a) && !given(b) {
                return Err(Code::NoOffsetsInPlane);
            }
            let offset = [a, b].map(|axis| self.length(self.words.ijk[axis]));
            self.words.used(b"IJK");
            arc::check(chord, offset)?;
            offset
        };
        if !self.abilities.axes[a] || !self.abilities.axes[b] {
            return Err(Code::InvalidTarget);
        }
        Ok(offset)
    }

    fn jog(mut self, checked: &Checked) -> Result<Block, Code> {
        if self.words.exceeds_a_jog() || !matches!(self.words.once, None | Some(Once::Machine)) {
            return Err(Code::InvalidJog);
        }
        // Without axis words, the firmware's jog goes to the machine's zero.
        let target = if self.axis_command.is_some() { checked.target } else { Axes::default() };
        if self.memory.settings.soft_limits() && self.memory.settings.is_beyond(target) {
            return Err(Code::TravelExceeded);
        }
        let line = Straight { to: target, rate: Rate::Jog(self.now.feed) };
        self.now = Modal { position: target, ..self.before.clone() };
        Ok(Block { steps: VecDeque::from([Step::Line(line)]), modal: self.now })
    }

    /// What the block does, in the order of the standard.
    fn block(mut self, checked: &Checked) -> Block {
        let mut steps = VecDeque::new();
        self.now.rpm = self.rpm(checked);
        let (before, words) = (self.before, &self.words);
        let turns = self.now.spindle != Spindle::Off;
        let changed = before.spindle != self.now.spindle;
        if changed || (turns && before.rpm != self.now.rpm) {
            steps.push_back(Step::Spindle { sense: self.now.spindle, rpm: self.now.rpm });
        }
        if before.flood != self.now.flood {
            steps.push_back(Step::Flood(self.now.flood));
        }
        if words.once == Some(Once::Dwell) {
            steps.push_back(Step::Dwell { seconds: words.p });
        }
        if let Some(lengthens) = words.tool_length {
            self.now.tool_length = if lengthens { self.axis_value(Z) } else { 0.0 };
        }
        if words.once == Some(Once::ResetShift) {
            self.now.shift = [0.0; MOST];
        }
        let origin = |modal: &Modal| modal.origin(&self.memory.systems);
        let moved = before.system != self.now.system || origin(before) != origin(&self.now);
        if moved || matches!(words.once, Some(Once::Shift | Once::ResetShift)) {
            steps.push_back(Step::Origin);
        }
        self.once(checked, &mut steps);
        if self.axis_command == Some(AxisCommand::Motion) {
            self.moves(checked, &mut steps);
        }
        match self.words.flow {
            Some(Flow::Pause) => steps.push_back(Step::Pause),
            Some(Flow::End) => {
                self.now = Modal {
                    motion: Motion::Linear,
                    plane: 0,
                    incremental: false,
                    feed_mode: FeedMode::PerMinute,
                    surface: false,
                    speed: if self.now.surface { self.now.rpm } else { self.now.speed },
                    system: 0,
                    spindle: Spindle::Off,
                    flood: false,
                    ..self.now
                };
                steps.push_back(Step::End);
            }
            None => {}
        }
        Block { steps, modal: self.now }
    }

    /// How fast the spindle turns from this block on.
    fn rpm(&self, checked: &Checked) -> f32 {
        let (before, now) = (self.before, &self.now);
        if !now.surface {
            return now.speed;
        }
        let cuts = self.axis_command == Some(AxisCommand::Motion) && now.motion != Motion::Rapid;
        let same = (before.spindle, before.speed) == (now.spindle, now.speed);
        let follows = before.surface && self.words.surface.is_none() && same;
        if follows && !cuts {
            return before.rpm;
        }
        let origin = now.origin(&self.memory.systems)[X];
        let radius = |place: Axes| (place[X] - origin).abs();
        let radius = if cuts { radius(before.position).max(radius(checked.target)) } else { radius(before.position) };
        let (fastest, _) = self.memory.settings.spindle_rpm();
        let most = if now.most_rpm > 0.0 { now.most_rpm.min(fastest) } else { fastest };
        // In the middle it is without limit.
        let rpm = (now.speed * 1_000.0 / (core::f32::consts::TAU * radius)).min(most);
        if follows && (rpm - before.rpm).abs() <= OFF * rpm { before.rpm } else { rpm }
    }

    /// What is done for this block only and concerns places.
    fn once(&mut self, checked: &Checked, steps: &mut VecDeque<Step>) {
        match self.words.once {
            Some(Once::SetSystem) => {
                let (system, origin) = checked.system;
                steps.push_back(Step::System { system, origin });
            }
            Some(Once::SetHome(home)) => steps.push_back(Step::Home { home, place: self.before.position }),
            Some(Once::GoHome(home)) => {
                if self.axis_command.is_some() {
                    steps.push_back(Step::Line(Straight { to: checked.target, rate: Rate::Rapid }));
                }
                let mut place = self.memory.homes[home];
                if self.words.has_axes() {
                    for axis in (0..MOST).filter(|axis| !self.words.has_axis(*axis)) {
                        place[axis] = self.before.position[axis];
                    }
                }
                steps.push_back(Step::Line(Straight { to: place, rate: Rate::Rapid }));
                self.now.position = place;
            }
            _ => {}
        }
    }

    fn moves(&mut self, checked: &Checked, steps: &mut VecDeque<Step>) {
        let to = checked.target;
        let feed = match self.now.feed_mode {
            FeedMode::PerMinute => Rate::Feed(self.now.feed),
            FeedMode::InverseTime => Rate::PerMinute(self.now.feed),
            FeedMode::PerTurn => Rate::PerTurn(self.now.feed),
        };
        steps.push_back(match self.now.motion {
            Motion::None => return,
            Motion::Rapid => Step::Line(Straight { to, rate: Rate::Rapid }),
            Motion::Linear => Step::Line(Straight { to, rate: feed }),
            Motion::Arc { clockwise } => {
                let tolerance = self.memory.settings.arc_tolerance();
                let plane = self.now.plane_axes();
                Step::Arc(Arc::new(self.before.position, to, plane, checked.offset, clockwise, tolerance, feed))
            }
            Motion::Probe(probe) => Step::Probe { probe, line: Straight { to, rate: feed } },
        });
        self.now.position = to;
    }
}
