//! The frame: eight bytes from the PC, and the sub-frame of it that each slave gets (paper, §3).
//!
//! | byte | meaning | unit | range |
//! |---|---|---|---|
//! | 0 | spindle speed | 20 rpm | 0 (stop), 10…200 |
//! | 1 | transverse speed | encoder counts per 30 ms | 1…225; 0 if the distance is 0 |
//! | 2, 3 | transverse distance, high byte first | encoder counts, relative | 0…65535 |
//! | 4 | transverse direction | 0 positive, 1 negative | |
//! | 5, 6 | depth distance, high byte first | slots of the linear encoder, relative | 0…65535 |
//! | 7 | depth direction | 0 positive, 1 negative | |
//!
//! The paper gives the bytes and their meaning; units, ranges, byte order and the direction codes are ours.

use core::fmt;

/// The bytes of a frame.
pub(super) const LENGTH: usize = 8;

/// A frame that may be executed: every field is in range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The spindle's sub-frame.
    pub spindle: SpindleSubFrame,
    /// The transverse axis's sub-frame.
    pub transverse: TransverseSubFrame,
    /// The depth axis's sub-frame.
    pub depth: DepthSubFrame,
}

/// One byte: the spindle's set point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpindleSubFrame {
    speed: u8,
}

/// Four bytes: how fast, how far and which way the transverse axis goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransverseSubFrame {
    speed: u8,
    distance: u16,
    direction: Direction,
}

/// Three bytes: how far and which way the depth axis goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthSubFrame {
    distance: u16,
    direction: Direction,
}

/// Which way an axis goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Code 0: away from the chuck, out of the work.
    Positive,
    /// Code 1.
    Negative,
}

/// Why a frame is refused. The letter follows `NAK`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refusal {
    /// A direction byte is neither 0 nor 1.
    Direction,
    /// A speed is out of range, or 0 with a distance to go.
    Speed,
    /// The line fell silent in mid-frame.
    CutShort,
    /// A frame came while another was already held.
    Overrun,
    /// The UART reported a framing or overrun error.
    LineError,
    /// A board has failed: the PC's line has not been silent since, or the frame needs that board.
    Faulted,
}

impl Refusal {
    /// Every reason.
    pub const ALL: [Self; 6] =
        [Self::Direction, Self::Speed, Self::CutShort, Self::Overrun, Self::LineError, Self::Faulted];

    const LETTERS: [(Self, u8, &'static str); 6] = [
        (Self::Direction, b'd', "direction"),
        (Self::Speed, b's', "speed"),
        (Self::CutShort, b'c', "cut short"),
        (Self::Overrun, b'o', "overrun"),
        (Self::LineError, b'l', "line error"),
        (Self::Faulted, b'f', "faulted"),
    ];

    /// The letter on the wire.
    pub fn letter(self) -> u8 {
        Self::LETTERS.iter().find(|row| row.0 == self).map_or(b'?', |row| row.1)
    }

    /// The reason that a letter stands for.
    pub fn from_letter(letter: u8) -> Option<Self> {
        Self::LETTERS.iter().find(|row| row.1 == letter).map(|row| row.0)
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(Self::LETTERS.iter().find(|row| row.0 == *self).map_or("?", |row| row.2))
    }
}

impl Direction {
    /// The code on the wire.
    pub const fn code(self) -> u8 {
        match self {
            Self::Positive => 0,
            Self::Negative => 1,
        }
    }

    /// +1 or −1.
    pub const fn sign(self) -> i64 {
        match self {
            Self::Positive => 1,
            Self::Negative => -1,
        }
    }

    fn parse(code: u8) -> Result<Self, Refusal> {
        match code {
            0 => Ok(Self::Positive),
            1 => Ok(Self::Negative),
            _ => Err(Refusal::Direction),
        }
    }
}

impl Frame {
    /// Bytes of a frame.
    pub const LENGTH: usize = LENGTH;

    /// Reads a frame.
    ///
    /// # Errors
    /// The first field that is out of range, as the master would refuse it.
    pub fn parse(bytes: [u8; LENGTH]) -> Result<Self, Refusal> {
        let [spindle, speed, high, low, direction, depth_high, depth_low, depth_direction] = bytes;
        Ok(Self {
            spindle: SpindleSubFrame::parse([spindle])?,
            transverse: TransverseSubFrame::parse([speed, high, low, direction])?,
            depth: DepthSubFrame::parse([depth_high, depth_low, depth_direction])?,
        })
    }

    /// A frame with the main motor at so many units that moves the feed by counts, at a speed, and the infeed by slots;
    /// either way. Whoever does not move has no speed.
    ///
    /// # Errors
    /// A speed that is out of range.
    pub fn moving(spindle: u8, counts: i32, speed: u8, slots: i32) -> Result<Self, Refusal> {
        let bytes = |way: i32| (way.unsigned_abs().min(u32::from(u16::MAX)) as u16).to_be_bytes();
        let ([high, low], [depth_high, depth_low]) = (bytes(counts), bytes(slots));
        let speed = if counts == 0 { 0 } else { speed };
        Self::parse([spindle, speed, high, low, u8::from(counts < 0), depth_high, depth_low, u8::from(slots < 0)])
    }

    /// The bytes on the wire.
    pub fn emit(&self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        bytes[..1].copy_from_slice(&self.spindle.emit());
        bytes[1..5].copy_from_slice(&self.transverse.emit());
        bytes[5..].copy_from_slice(&self.depth.emit());
        bytes
    }
}

impl SpindleSubFrame {
    /// Bytes of this sub-frame.
    pub const LENGTH: usize = 1;
    /// Revolutions per minute of one unit: with 50 pulses a revolution and 30 ms it is half an encoder count.
    pub const RPM_PER_UNIT: u16 = 20;

    /// Reads the sub-frame: 0 stops, 10 to 200 is 200 to 4000 rpm (paper, §1.1).
    ///
    /// # Errors
    /// [`Refusal::Speed`] for anything else.
    pub const fn parse([speed]: [u8; Self::LENGTH]) -> Result<Self, Refusal> {
        match speed {
            0 | 10..=200 => Ok(Self { speed }),
            _ => Err(Refusal::Speed),
        }
    }

    /// The bytes on the wire.
    pub const fn emit(self) -> [u8; Self::LENGTH] {
        [self.speed]
    }

    /// The set point in units of 20 rpm.
    pub const fn units(self) -> u8 {
        self.speed
    }

    /// The set point in revolutions per minute.
    pub const fn rpm(self) -> u16 {
        self.speed as u16 * Self::RPM_PER_UNIT
    }
}

impl TransverseSubFrame {
    /// Bytes of this sub-frame.
    pub const LENGTH: usize = 4;
    /// The fastest speed, in counts per 30 ms: 500 rpm at 900 counts a revolution (paper, §4).
    pub const SPEED_MAX: u8 = 225;

    /// Reads the sub-frame.
    ///
    /// # Errors
    /// [`Refusal::Speed`] above [`Self::SPEED_MAX`] or if a distance would never be covered, [`Refusal::Direction`].
    pub fn parse([speed, high, low, direction]: [u8; Self::LENGTH]) -> Result<Self, Refusal> {
        let distance = u16::from_be_bytes([high, low]);
        if speed > Self::SPEED_MAX || (speed == 0 && distance != 0) {
            return Err(Refusal::Speed);
        }
        Ok(Self { speed, distance, direction: Direction::parse(direction)? })
    }

    /// The bytes on the wire.
    pub const fn emit(self) -> [u8; Self::LENGTH] {
        let [high, low] = self.distance.to_be_bytes();
        [self.speed, high, low, self.direction.code()]
    }

    /// Encoder counts per 30 ms.
    pub const fn speed(self) -> u8 {
        self.speed
    }

    /// Encoder counts to go; 0 is "do not move".
    pub const fn distance(self) -> u16 {
        self.distance
    }

    /// Which way.
    pub const fn direction(self) -> Direction {
        self.direction
    }
}

impl DepthSubFrame {
    /// Bytes of this sub-frame.
    pub const LENGTH: usize = 3;

    /// Reads the sub-frame.
    ///
    /// # Errors
    /// [`Refusal::Direction`].
    pub fn parse([high, low, direction]: [u8; Self::LENGTH]) -> Result<Self, Refusal> {
        Ok(Self { distance: u16::from_be_bytes([high, low]), direction: Direction::parse(direction)? })
    }

    /// The bytes on the wire.
    pub const fn emit(self) -> [u8; Self::LENGTH] {
        let [high, low] = self.distance.to_be_bytes();
        [high, low, self.direction.code()]
    }

    /// Slots to go; 0 is "do not move".
    pub const fn distance(self) -> u16 {
        self.distance
    }

    /// Which way.
    pub const fn direction(self) -> Direction {
        self.direction
    }
}

impl TryFrom<[u8; SpindleSubFrame::LENGTH]> for SpindleSubFrame {
    type Error = Refusal;

    fn try_from(bytes: [u8; SpindleSubFrame::LENGTH]) -> Result<Self, Refusal> {
        Self::parse(bytes)
    }
}

impl TryFrom<[u8; TransverseSubFrame::LENGTH]> for TransverseSubFrame {
    type Error = Refusal;

    fn try_from(bytes: [u8; TransverseSubFrame::LENGTH]) -> Result<Self, Refusal> {
        Self::parse(bytes)
    }
}

impl TryFrom<[u8; DepthSubFrame::LENGTH]> for DepthSubFrame {
    type Error = Refusal;

    fn try_from(bytes: [u8; DepthSubFrame::LENGTH]) -> Result<Self, Refusal> {
        Self::parse(bytes)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Byte-exact; the worked example of the documentation.
    const EXAMPLE: [u8; LENGTH] = [0x4b, 0x70, 0x23, 0x28, 0x01, 0x00, 0x38, 0x00];

    #[test]
    fn the_example_is_1500_rpm_minus_9000_counts_plus_56_slots() {
        let frame = Frame::parse(EXAMPLE).unwrap();
        assert_eq!(frame.spindle.rpm(), 1500);
        assert_eq!((frame.transverse.speed(), frame.transverse.distance()), (112, 9000));
        assert_eq!(frame.transverse.direction(), Direction::Negative);
        assert_eq!((frame.depth.distance(), frame.depth.direction()), (56, Direction::Positive));
    }

    #[test]
    fn what_is_out_of_range_is_refused() {
        let with = |changes: &[(usize, u8)]| {
            let mut bytes = EXAMPLE;
            changes.iter().for_each(|(at, byte)| bytes[*at] = *byte);
            Frame::parse(bytes).err()
        };
        for (changes, expected) in [
            (&[(0, 0)][..], None),
            (&[(0, 9)], Some(Refusal::Speed)),
            (&[(0, 10)], None),
            (&[(0, 200)], None),
            (&[(0, 201)], Some(Refusal::Speed)),
            (&[(1, 225)], None),
            (&[(1, 226)], Some(Refusal::Speed)),
            (&[(1, 0)], Some(Refusal::Speed)),
            (&[(1, 0), (2, 0), (3, 0)], None),
            (&[(4, 2)], Some(Refusal::Direction)),
            (&[(7, 0xff)], Some(Refusal::Direction)),
            // A direction is checked even where nothing moves: it catches slipped framing.
            (&[(5, 0), (6, 0), (7, 2)], Some(Refusal::Direction)),
        ] {
            assert_eq!(with(changes), expected, "{changes:?}");
        }
    }

    #[test]
    fn every_reason_has_a_letter_of_its_own() {
        for (refusal, letter, _) in Refusal::LETTERS {
            assert!(letter.is_ascii_lowercase());
            assert_eq!(Refusal::from_letter(refusal.letter()), Some(refusal));
        }
    }

    #[test]
    fn refusals_have_these_letters_and_words() {
        let expected = [
            (Refusal::Direction, b'd', "direction"),
            (Refusal::Speed, b's', "speed"),
            (Refusal::CutShort, b'c', "cut short"),
            (Refusal::Overrun, b'o', "overrun"),
            (Refusal::LineError, b'l', "line error"),
            (Refusal::Faulted, b'f', "faulted"),
        ];
        let found = Refusal::ALL.map(|refusal| (refusal, refusal.letter(), refusal.to_string()));
        assert_eq!(found, expected.map(|(refusal, letter, word)| (refusal, letter, word.to_owned())));
        assert_eq!([b'x', 0, b'D'].map(Refusal::from_letter), [None; 3]);
    }

    #[test]
    fn a_direction_is_a_code_and_a_sign() {
        for (direction, code, sign) in [(Direction::Positive, 0, 1), (Direction::Negative, 1, -1)] {
            assert_eq!((direction.code(), direction.sign()), (code, sign));
            assert_eq!(Direction::parse(code), Ok(direction));
        }
        assert_eq!([2, 3, 0x80, 0xff].map(Direction::parse), [Err(Refusal::Direction); 4]);
    }

    #[test]
    fn each_sub_frame_goes_over_its_own_wire_byte_by_byte() {
        for units in [0, 10, 75, 200] {
            let sub_frame = SpindleSubFrame::parse([units]).unwrap();
            assert_eq!((sub_frame.emit(), sub_frame.units(), sub_frame.rpm()), ([units], units, 20 * u16::from(units)));
        }
        for (bytes, speed, distance, direction) in [
            ([0, 0, 0, 0], 0, 0, Direction::Positive),
            ([0, 0, 0, 1], 0, 0, Direction::Negative),
            ([1, 0x01, 0x02, 0], 1, 0x0102, Direction::Positive),
            ([225, 0xff, 0xfe, 1], 225, 0xfffe, Direction::Negative),
        ] {
            let sub_frame = TransverseSubFrame::parse(bytes).unwrap();
            assert_eq!((sub_frame.speed(), sub_frame.distance(), sub_frame.direction()), (speed, distance, direction));
            assert_eq!(sub_frame.emit(), bytes);
        }
        for (bytes, distance, direction) in [
            ([0, 0, 0], 0, Direction::Positive),
            ([0x01, 0x02, 1], 0x0102, Direction::Negative),
            ([0xff, 0xfe, 0], 0xfffe, Direction::Positive),
        ] {
            let sub_frame = DepthSubFrame::parse(bytes).unwrap();
            assert_eq!((sub_frame.distance(), sub_frame.direction()), (distance, direction));
            assert_eq!(sub_frame.emit(), bytes);
        }
    }

    #[test]
    fn a_sub_frame_out_of_range_is_refused() {
        assert_eq!([1, 9, 201, 255].map(|units| SpindleSubFrame::parse([units])), [Err(Refusal::Speed); 4]);
        for bytes in [[226, 0, 1, 0], [0, 0, 1, 0], [0, 1, 0, 0], [255, 0, 0, 9]] {
            assert_eq!(TransverseSubFrame::parse(bytes), Err(Refusal::Speed), "{bytes:?}");
        }
        assert_eq!(TransverseSubFrame::parse([1, 0, 1, 2]), Err(Refusal::Direction));
        assert_eq!(DepthSubFrame::parse([0, 1, 2]), Err(Refusal::Direction));
    }

    /// The bytes of frames that may be executed.
    fn valid() -> impl Strategy<Value = [u8; LENGTH]> {
        let spindle = prop_oneof![Just(0u8), 10..=200u8];
        let transverse = (1..=225u8, any::<[u8; 2]>(), 0..2u8);
        let depth = (any::<[u8; 2]>(), 0..2u8);
        (spindle, transverse, depth).prop_map(|(units, (speed, [high, low], way), ([depth_high, depth_low], out))| {
            [units, speed, high, low, way, depth_high, depth_low, out]
        })
    }

    proptest! {
        #[test]
        fn what_is_parsed_is_emitted(bytes in valid()) {
            prop_assert_eq!(Frame::parse(bytes).map(|frame| frame.emit()), Ok(bytes));
        }

        #[test]
        fn any_bytes_are_parsed_or_refused(bytes: [u8; LENGTH]) {
            if let Ok(frame) = Frame::parse(bytes) {
                prop_assert_eq!(frame.emit(), bytes);
            }
        }
    }
}
