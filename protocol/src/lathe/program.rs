//! Programs: text files of frames, a line of eight hexadecimal bytes each.
//!
//! `#` starts a comment, blank lines are skipped. The bytes are sent as they stand, in range or not: a program may well
//! be written to see a frame refused.

use crate::lathe::frame::{Frame, LENGTH};

/// A program, ready to be sent.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Program {
    /// The frames, in order.
    pub frames: Vec<[u8; LENGTH]>,
}

/// What is wrong with a program's text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProgramError {
    /// A word is not a byte.
    #[error("line {line}, column {column}: expected a byte as two hexadecimal digits, found '{found}'")]
    NotAByte {
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// The word.
        found: String,
    },
    /// A line holds too few or too many bytes.
    #[error("line {line}: expected {LENGTH} bytes, found {found}")]
    Length {
        /// From 1.
        line: usize,
        /// How many there are.
        found: usize,
    },
    /// There is no frame at all.
    #[error("expected at least one frame (a line of {LENGTH} hexadecimal bytes), found none")]
    Empty,
}

impl Program {
    /// The dialect of the rigs that it can be played on, as their files name it.
    pub const DIALECT: &'static str = "lathe";

    /// Reads a program.
    ///
    /// # Errors
    /// [`ProgramError`]: where, what was expected, what was found.
    pub fn parse(text: &str) -> Result<Self, ProgramError> {
        let mut frames = Vec::new();
        for (n, text) in text.lines().enumerate() {
            let line = n + 1;
            let code = text.split('#').next().unwrap_or_default();
            let bytes = code.split_whitespace().map(|word| {
                let column = word.as_ptr() as usize - text.as_ptr() as usize;
                let column = text[..column].chars().count() + 1;
                parse_byte(word).ok_or_else(|| ProgramError::NotAByte { line, column, found: word.to_owned() })
            });
            let bytes = bytes.collect::<Result<Vec<u8>, _>>()?;
            if bytes.is_empty() {
                continue;
            }
            let found = bytes.len();
            frames.push(bytes.try_into().map_err(|_| ProgramError::Length { line, found })?);
        }
        if frames.is_empty() { Err(ProgramError::Empty) } else { Ok(Self { frames }) }
    }

    /// The bytes on the wire.
    pub fn bytes(&self) -> Vec<u8> {
        self.frames.concat()
    }

    /// Where each frame asks the tool to be when it is done, in order. Distances are relative, so the places are too:
    /// to where the tool stands before the first frame. A frame that would be refused moves nothing.
    pub fn destinations(&self) -> Vec<Destination> {
        let mut place = Destination::default();
        let go = |bytes: &[u8; LENGTH]| {
            if let Ok(frame) = Frame::parse(*bytes) {
                let (transverse, depth) = (frame.transverse, frame.depth);
                place.transverse += transverse.direction().sign() * i64::from(transverse.distance());
                place.depth += depth.direction().sign() * i64::from(depth.distance());
            }
            place
        };
        self.frames.iter().map(go).collect()
    }
}

/// Where a program asks the tool to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Destination {
    /// Encoder counts of the transverse axis, away from the chuck.
    pub transverse: i64,
    /// Slots of the depth axis, out of the work.
    pub depth: i64,
}

fn parse_byte(word: &str) -> Option<u8> {
    let digits = word.len() == 2 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
    digits.then(|| u8::from_str_radix(word, 16).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn comments_and_blank_lines_are_skipped() {
        let text = "# a shaft\r\n\n 4B 70 23 28 01 00 38 00  # rough\n4b7 # no";
        let error = ProgramError::NotAByte { line: 4, column: 1, found: "4b7".to_owned() };
        assert_eq!(Program::parse(text), Err(error));
        let program = Program::parse(&text[..text.len() - 8]).unwrap();
        assert_eq!(program.frames, [[0x4b, 0x70, 0x23, 0x28, 0x01, 0x00, 0x38, 0x00]]);
    }

    #[test]
    fn destinations_add_up_and_a_refused_frame_moves_nothing() {
        let text = "4B 70 23 28 01 00 05 01\n4B 70 00 0A 00 00 02 00\n4B 70 00 0A 02 00 02 00\n00 00 00 00 00 00 00 00";
        let places = Program::parse(text).unwrap().destinations();
        let places: Vec<_> = places.iter().map(|place| (place.transverse, place.depth)).collect();
        assert_eq!(places, [(-9000, -5), (-8990, -3), (-8990, -3), (-8990, -3)]);
    }

    #[test]
    fn the_bytes_are_those_of_the_frames_in_order() {
        let program = Program::parse("00 01 02 03 04 05 06 07\nff fe FD fc fb fa f9 f8").unwrap();
        let bytes = [0, 1, 2, 3, 4, 5, 6, 7, 0xff, 0xfe, 0xfd, 0xfc, 0xfb, 0xfa, 0xf9, 0xf8];
        assert_eq!((program.frames.len(), program.bytes()), (2, bytes.to_vec()));
    }

    #[test]
    fn says_where_and_what() {
        let error = |text| Program::parse(text).unwrap_err().to_string();
        assert_eq!(error("\n00 01 02\n"), "line 2: expected 8 bytes, found 3");
        assert_eq!(error("00 é +1"), "line 1, column 4: expected a byte as two hexadecimal digits, found 'é'");
        assert!(error("# nothing").starts_with("expected at least one frame"));
        assert_eq!(error("  00 0").as_str(), "line 1, column 6: expected a byte as two hexadecimal digits, found '0'");
        assert_eq!(error("\n\n +1"), "line 3, column 2: expected a byte as two hexadecimal digits, found '+1'");
        assert_eq!(error("000"), "line 1, column 1: expected a byte as two hexadecimal digits, found '000'");
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in ".{0,80}") {
            let _ = Program::parse(&text);
        }
    }
}
