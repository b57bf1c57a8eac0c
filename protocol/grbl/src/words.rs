//! The words of a block, and what the firmware says of them one by one.

use crate::axes::{self, Axes};
use crate::code::Code;
use crate::memory::Settings;
use crate::modal::{FeedMode, Motion, Probe, Spindle};
use crate::number;

/// The largest number of a tool.
const TOOL_MOST: f32 = 255.0;

/// A command that stays in force for its block only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Once {
    /// G4.
    Dwell,
    /// G10.
    SetSystem,
    /// G28, G30.
    GoHome(usize),
    /// G28.1, G30.1.
    SetHome(usize),
    /// G53.
    Machine,
    /// G92.
    Shift,
    /// G92.1.
    ResetShift,
}

/// The end of the program, or a pause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Flow {
    /// M0.
    Pause,
    /// M2, M30.
    End,
}

/// What wants the axis words of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AxisCommand {
    /// G10, G28, G30, G92.
    Once,
    /// G0 to G3, G38.
    Motion,
    /// G43.1, G49.
    ToolLength,
}

/// The modal groups, as the bits of what a block has.
mod group {
    pub(super) const ONCE: u16 = 1 << 0;
    pub(super) const MOTION: u16 = 1 << 1;
    pub(super) const PLANE: u16 = 1 << 2;
    pub(super) const DISTANCE: u16 = 1 << 3;
    pub(super) const ARC_DISTANCE: u16 = 1 << 4;
    pub(super) const FEED: u16 = 1 << 5;
    pub(super) const UNITS: u16 = 1 << 6;
    pub(super) const CUTTER: u16 = 1 << 7;
    pub(super) const TOOL_LENGTH: u16 = 1 << 8;
    pub(super) const SYSTEM: u16 = 1 << 9;
    pub(super) const PATH: u16 = 1 << 10;
    pub(super) const FLOW: u16 = 1 << 11;
    pub(super) const SPINDLE: u16 = 1 << 12;
    pub(super) const COOLANT: u16 = 1 << 13;
    pub(super) const DIAMETER: u16 = 1 << 14;
    pub(super) const SPEED: u16 = 1 << 15;
    /// What a jog may have.
    pub(super) const OF_JOG: u16 = ONCE | DISTANCE | UNITS;
}

/// The words of a block.
#[derive(Clone, Debug, Default)]
pub(crate) struct Words {
    groups: u16,
    /// The letters of the value words that nothing has used yet, as bits from A on.
    letters: u32,
    /// Which axes are named.
    axes: Axes<bool>,
    pub(crate) axis_command: Option<AxisCommand>,
    pub(crate) once: Option<Once>,
    pub(crate) motion: Option<Motion>,
    pub(crate) plane: Option<usize>,
    pub(crate) incremental: Option<bool>,
    pub(crate) feed_mode: Option<FeedMode>,
    /// G7, and not G8.
    pub(crate) diameter: Option<bool>,
    /// G96, and not G97.
    pub(crate) surface: Option<bool>,
    pub(crate) inches: Option<bool>,
    /// G43.1, and not G49.
    pub(crate) tool_length: Option<bool>,
    pub(crate) system: Option<usize>,
    pub(crate) flow: Option<Flow>,
    pub(crate) spindle: Option<Spindle>,
    pub(crate) flood: Option<bool>,
    pub(crate) d: f32,
    pub(crate) f: f32,
    pub(crate) ijk: [f32; 3],
    pub(crate) l: u8,
    pub(crate) n: i32,
    pub(crate) p: f32,
    pub(crate) r: f32,
    pub(crate) s: f32,
    pub(crate) t: u8,
    /// Of the axes, in the units of the block.
    pub(crate) axis_values: Axes,
}

impl Words {
    /// Reads the words of a block. The first fault counts.
    pub(crate) fn read(text: &[u8], settings: &Settings) -> Result<Self, Code> {
        let mut words = Self::default();
        let mut rest = text;
        while let [letter, after @ ..] = rest {
            if !letter.is_ascii_uppercase() {
                return Err(Code::ExpectedLetter);
            }
            let (value, after) = number::read(after).ok_or(Code::BadNumber)?;
            rest = after;
            // What does not fit is cut off: a command is a byte.
            let whole = number::unsigned(value) as u8;
            let hundredths = number::unsigned(libm::roundf(100.0 * (value - f32::from(whole)))) as u16;
            match letter {
                b'G' => words.take_g(whole, hundredths, settings.lathe_mode())?,
                b'M' => words.take_m(whole, hundredths)?,
                letter => words.take_value(*letter, value, whole, settings)?,
            }
        }
        Ok(words)
    }

    fn take_group(&mut self, group: u16, hundredths: u16) -> Result<(), Code> {
        if hundredths > 0 {
            return Err(Code::NotInteger);
        }
        if self.groups & group != 0 {
            return Err(Code::ModalGroup);
        }
        self.groups |= group;
        Ok(())
    }

    fn claim_axes(&mut self, command: AxisCommand) -> Result<(), Code> {
        if self.axis_command.is_some() {
            return Err(Code::AxisConflict);
        }
        self.axis_command = Some(command);
        Ok(())
    }

    fn take_g(&mut self, number: u8, hundredths: u16, lathe: bool) -> Result<(), Code> {
        match (number, hundredths) {
            (10 | 28 | 30 | 92, 0) => self.claim_axes(AxisCommand::Once)?,
            (28 | 30 | 92, hundredths) if hundredths != 10 => return Err(Code::UnsupportedCommand),
            (0..=3 | 38, _) => self.claim_axes(AxisCommand::Motion)?,
            (43 | 49, _) => self.claim_axes(AxisCommand::ToolLength)?,
            _ => {}
        }
        let point_one = hundredths == 10;
        // Of these, what follows the point has been understood.
        let mut left = hundredths;
        let group = match number {
            4 | 10 | 28 | 30 | 53 | 92 => {
                if matches!(number, 28 | 30 | 92) {
                    left = 0;
                }
                self.once = Some(match (number, point_one) {
                    (4, _) => Once::Dwell,
                    (10, _) => Once::SetSystem,
                    (28 | 30, false) => Once::GoHome(usize::from(number == 30)),
                    (28 | 30, true) => Once::SetHome(usize::from(number == 30)),
                    (53, _) => Once::Machine,
                    (_, false) => Once::Shift,
                    (_, true) => Once::ResetShift,
                });
                group::ONCE
            }
            0..=3 | 38 | 80 => {
                self.motion = Some(match number {
                    0 => Motion::Rapid,
                    1 => Motion::Linear,
                    2 | 3 => Motion::Arc { clockwise: number == 2 },
                    38 => {
                        left = 0;
                        let (away, no_error) = match hundredths {
                            20 => (false, false),
                            30 => (false, true),
                            40 => (true, false),
                            50 => (true, true),
                            _ => return Err(Code::UnsupportedCommand),
                        };
                        Motion::Probe(Probe { away, no_error })
                    }
                    _ => Motion::None,
                });
                group::MOTION
            }
            17..=19 => {
                self.plane = Some(usize::from(number - 17));
                group::PLANE
            }
            90 | 91 if hundredths == 0 => {
                self.incremental = Some(number == 91);
                group::DISTANCE
            }
            91 if point_one => {
                left = 0;
                group::ARC_DISTANCE
            }
            90 | 91 => return Err(Code::UnsupportedCommand),
            93 | 94 => {
                self.feed_mode = Some(if number == 93 { FeedMode::InverseTime } else { FeedMode::PerMinute });
                group::FEED
            }
            95 if lathe => {
                self.feed_mode = Some(FeedMode::PerTurn);
                group::FEED
            }
            7 | 8 if lathe => {
                self.diameter = Some(number == 7);
                group::DIAMETER
            }
            96 | 97 if lathe => {
                self.surface = Some(number == 96);
                group::SPEED
            }
            20 | 21 => {
                self.inches = Some(number == 20);
                group::UNITS
            }
            40 => group::CUTTER,
            49 | 43 if number == 49 || point_one => {
                left = 0;
                self.tool_length = Some(number == 43);
                group::TOOL_LENGTH
            }
            54..=59 => {
                self.system = Some(usize::from(number - 54));
                group::SYSTEM
            }
            61 if hundredths == 0 => group::PATH,
            _ => return Err(Code::UnsupportedCommand),
        };
        self.take_group(group, left)
    }

    fn take_m(&mut self, number: u8, hundredths: u16) -> Result<(), Code> {
        if hundredths > 0 {
            return Err(Code::NotInteger);
        }
        let group = match number {
            0..=2 | 30 => {
                self.flow = match number {
                    0 => Some(Flow::Pause),
                    // There is no switch for optional stops.
                    1 => None,
                    _ => Some(Flow::End),
                };
                group::FLOW
            }
            3..=5 => {
                self.spindle = Some(match number {
                    3 => Spindle::Clockwise,
                    4 => Spindle::Counterclockwise,
                    _ => Spindle::Off,
                });
                group::SPINDLE
            }
            8 | 9 => {
                self.flood = Some(number == 8);
                group::COOLANT
            }
            _ => return Err(Code::UnsupportedCommand),
        };
        self.take_group(group, 0)
    }

    fn take_value(&mut self, letter: u8, value: f32, whole: u8, settings: &Settings) -> Result<(), Code> {
        let axis = axes::of_letter(letter, settings.axes);
        match letter {
            b'D' if settings.lathe_mode() => self.d = value,
            b'F' => self.f = value,
            b'I'..=b'K' => self.ijk[usize::from(letter - b'I')] = value,
            b'L' => self.l = whole,
            b'N' => self.n = number::signed(value),
            b'P' => self.p = value,
            b'R' => self.r = value,
            b'S' => self.s = value,
            b'T' if value > TOOL_MOST => return Err(Code::ToolTooLarge),
            b'T' => self.t = whole,
            _ => self.axis_values[axis.ok_or(Code::UnsupportedCommand)?] = value,
        }
        let bit = bit(letter);
        if self.letters & bit != 0 {
            return Err(Code::WordRepeated);
        }
        if b"DFNPST".contains(&letter) && value < 0.0 {
            return Err(Code::NegativeValue);
        }
        self.letters |= bit;
        if let Some(axis) = axis {
            self.axes[axis] = true;
        }
        Ok(())
    }

    /// Whether the block has a value word that nothing has used yet.
    pub(crate) const fn has(&self, letter: u8) -> bool {
        self.letters & bit(letter) != 0
    }

    /// Value words that have been used.
    pub(crate) fn used(&mut self, letters: &[u8]) {
        letters.iter().for_each(|letter| self.letters &= !bit(*letter));
    }

    /// Whether value words are left that nothing has used.
    pub(crate) const fn has_unused(&self) -> bool {
        self.letters != 0
    }

    /// Whether the block names an axis.
    pub(crate) const fn has_axis(&self, axis: usize) -> bool {
        self.axes[axis]
    }

    /// Which axes the block names.
    pub(crate) fn named_axes(&self) -> impl Iterator<Item = usize> {
        let named = self.axes;
        (0..axes::MOST).filter(move |axis| named[*axis])
    }

    /// Whether the block names any axis.
    pub(crate) const fn has_axes(&self) -> bool {
        matches!(self.axes, [true, ..] | [_, true, ..] | [.., true, _] | [.., true])
    }

    /// Whether the block has commands that a jog must not have.
    pub(crate) const fn exceeds_a_jog(&self) -> bool {
        self.groups & !group::OF_JOG != 0
    }
}

const fn bit(letter: u8) -> u32 {
    1 << (letter - b'A')
}
