//! The numbers that the firmware answers with.

/// Why a line is refused: `error:` and this number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Code {
    /// A word has no letter.
    ExpectedLetter = 1,
    /// A letter has no number.
    BadNumber = 2,
    /// A `$` line that is none.
    InvalidStatement = 3,
    /// A value is negative that may not be.
    NegativeValue = 4,
    /// Homing is switched off.
    HomingDisabled = 5,
    /// The step pulse is shorter than 3 us.
    StepPulseTooShort = 6,
    /// The machine is not idle.
    NotIdle = 8,
    /// Alarm or jog: no G-code.
    Locked = 9,
    /// Soft limits need homing.
    SoftLimitsNeedHoming = 10,
    /// The line is too long.
    LineTooLong = 11,
    /// A jog would leave the machine's travel.
    TravelExceeded = 15,
    /// A jog has words that it must not have.
    InvalidJog = 16,
    /// A command is unknown.
    UnsupportedCommand = 20,
    /// Two words of one modal group.
    ModalGroup = 21,
    /// No feed rate.
    UndefinedFeed = 22,
    /// A command's number is no integer.
    NotInteger = 23,
    /// Two commands want the axis words.
    AxisConflict = 24,
    /// A word is repeated.
    WordRepeated = 25,
    /// A command has no axis words.
    NoAxisWords = 26,
    /// A line number is too large.
    InvalidLineNumber = 27,
    /// A value is missing.
    ValueMissing = 28,
    /// Coordinate systems above G59.
    UnsupportedSystem = 29,
    /// G53 without G0 or G1.
    G53Motion = 30,
    /// Axis words that nothing wants.
    AxisWordsExist = 31,
    /// An arc without axis words in its plane.
    NoAxisWordsInPlane = 32,
    /// A motion's target cannot be.
    InvalidTarget = 33,
    /// An arc's radius is too small.
    ArcRadius = 34,
    /// An arc without offsets in its plane.
    NoOffsetsInPlane = 35,
    /// Words that nothing wants.
    UnusedWords = 36,
    /// G43.1 with another axis than Z.
    ToolLengthAxis = 37,
    /// A tool's number is too large.
    ToolTooLarge = 38,
}

/// Why the machine is locked: `ALARM:` and this number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Alarm {
    /// An end switch, or the end of an axis.
    HardLimit = 1,
    /// A target beyond the travel.
    SoftLimit = 2,
    /// Reset while it moved: the position may be lost.
    Aborted = 3,
    /// The probe was not in its initial state.
    ProbeInitial = 4,
    /// The probe met nothing.
    ProbeContact = 5,
    /// Reset during homing.
    HomingReset = 6,
    /// The door was opened during homing.
    HomingDoor = 7,
    /// Homing has not found an end.
    NoEnd = 9,
}

impl Alarm {
    /// Whether nothing but a reset is heard after it.
    pub(crate) const fn is_critical(self) -> bool {
        matches!(self, Self::HardLimit | Self::SoftLimit)
    }
}
