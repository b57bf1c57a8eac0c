//! Lines of bytes, and the words and numbers in a line.
//!
//! A line ends with LF, with CR LF or with a lone CR. Blanks mean nothing outside comments, not even inside a number;
//! upper and lower case are alike.

use crate::finding::{Read, fault};

/// No line is longer, in bytes: so a file without an end of line needs no memory.
pub(crate) const LINE_MAX: usize = 4096;

/// Cuts blocks of bytes into lines.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lines {
    /// A line that goes on in the next block.
    partial: Vec<u8>,
    number: usize,
    after_cr: bool,
}

impl Lines {
    /// Takes a block; gives each whole line with its number, from 1. A byte order mark is not part of a line.
    pub(crate) fn push(&mut self, mut bytes: &[u8], mut take: impl FnMut(usize, &[u8])) {
        while !bytes.is_empty() {
            if core::mem::take(&mut self.after_cr) && bytes[0] == b'\n' {
                bytes = &bytes[1..];
                continue;
            }
            let Some(end) = end_of_line(bytes) else {
                let room = (LINE_MAX + 8).saturating_sub(self.partial.len());
                self.partial.extend_from_slice(&bytes[..bytes.len().min(room)]);
                return;
            };
            let (line, rest) = bytes.split_at(end);
            self.after_cr = rest[0] == b'\r';
            bytes = &rest[1..];
            self.number += 1;
            if self.partial.is_empty() {
                take(self.number, without_mark(self.number, line));
            } else {
                let room = (LINE_MAX + 8).saturating_sub(self.partial.len());
                self.partial.extend_from_slice(&line[..line.len().min(room)]);
                take(self.number, without_mark(self.number, &self.partial));
                self.partial.clear();
            }
        }
    }

    /// The last line, if no end of line follows it.
    pub(crate) fn finish(&mut self, mut take: impl FnMut(usize, &[u8])) {
        let partial = core::mem::take(&mut self.partial);
        if !partial.is_empty() {
            self.number += 1;
            take(self.number, without_mark(self.number, &partial));
        }
    }

    /// How many lines there have been.
    pub(crate) const fn count(&self) -> usize {
        self.number
    }
}

/// Where the first LF or CR is. It looks at eight bytes at a time.
#[inline]
fn end_of_line(bytes: &[u8]) -> Option<usize> {
    const ONES: u64 = u64::from_ne_bytes([1; 8]);
    const HIGH: u64 = ONES << 7;
    let zero = |word: u64| word.wrapping_sub(ONES) & !word & HIGH;
    let (words, _) = bytes.as_chunks::<8>();
    let found = words.iter().position(|word| {
        let word = u64::from_ne_bytes(*word);
        zero(word ^ (ONES * u64::from(b'\n'))) | zero(word ^ (ONES * u64::from(b'\r'))) != 0
    });
    let from = found.unwrap_or(words.len()) * 8;
    bytes[from..].iter().position(|byte| matches!(byte, b'\n' | b'\r')).map(|end| from + end)
}

fn without_mark(number: usize, line: &[u8]) -> &[u8] {
    if number == 1 { line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line) } else { line }
}

/// A place in a line.
#[derive(Clone, Debug)]
pub(crate) struct Cursor<'a> {
    pub(crate) line: &'a [u8],
    pub(crate) at: usize,
}

/// Powers of ten that a float holds exactly.
const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// Reads digits onto a number; gives the place behind them. What gets too large is read again by the caller.
#[inline]
fn digits(line: &[u8], mut at: usize, mantissa: &mut u64) -> usize {
    // Eight at a time, while there are as many bytes.
    while let Some(eight) = line.get(at..).and_then(|rest| rest.first_chunk::<8>()) {
        let (value, count) = eight_digits(*eight);
        *mantissa = mantissa.wrapping_mul(WHOLE_TENS[count]).wrapping_add(value);
        at += count;
        if count < 8 {
            return at;
        }
    }
    while let Some(digit) = line.get(at).map(|byte| byte.wrapping_sub(b'0')).filter(|digit| *digit < 10) {
        *mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(digit));
        at += 1;
    }
    at
}

/// The number that these bytes begin with, and how many digits it has.
#[inline]
const fn eight_digits(bytes: [u8; 8]) -> (u64, usize) {
    const ONES: u64 = u64::from_ne_bytes([1; 8]);
    // A digit becomes its value; what is no digit has its high bit set below.
    let values = u64::from_le_bytes(bytes) ^ (ONES * 0x30);
    let others = (((values & (ONES * 0x7f)) + ONES * 0x76) | values) & (ONES * 0x80);
    let count = others.trailing_zeros() as usize / 8;
    if count == 0 {
        return (0, 0);
    }
    // Zeros in front make it eight digits; pairs, fours and eight of them are put together.
    let eight = values << (64 - 8 * count);
    let pairs = (eight.wrapping_mul(10 * 256 + 1) >> 8) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs.wrapping_mul(100 * 65_536 + 1) >> 16) & 0x0000_ffff_0000_ffff;
    (fours.wrapping_mul((10_000 << 32) + 1) >> 32, count)
}

/// Powers of ten for up to eight digits.
const WHOLE_TENS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// Up to here, each whole number is a float.
const EXACT: u64 = 1 << 53;

impl<'a> Cursor<'a> {
    pub(crate) const fn new(line: &'a [u8]) -> Self {
        Self { line, at: 0 }
    }

    /// The next byte that is no blank, in lower case; 0 at the end of the line.
    #[inline]
    pub(crate) fn peek(&mut self) -> u8 {
        while let Some(byte) = self.line.get(self.at) {
            match byte {
                b' ' | b'\t' | 0x0b | 0x0c => self.at += 1,
                byte => return byte.to_ascii_lowercase(),
            }
        }
        0
    }

    /// Goes past the byte that [`Self::peek`] has given.
    #[inline]
    pub(crate) fn skip(&mut self) {
        self.at += 1;
    }

    /// Goes past this byte, if it is the next.
    #[inline]
    pub(crate) fn take(&mut self, byte: u8) -> bool {
        let there = self.peek() == byte;
        self.at += usize::from(there);
        there
    }

    /// Goes past this word, if it is next; blanks may be inside it.
    pub(crate) fn take_word(&mut self, word: &[u8]) -> bool {
        let before = self.at;
        let there = word.iter().all(|byte| self.take(*byte));
        if !there {
            self.at = before;
        }
        there
    }

    /// What stands here, for a message.
    pub(crate) fn found(&mut self) -> String {
        if self.peek() == 0 {
            return "the end of the line".to_owned();
        }
        let rest = String::from_utf8_lossy(&self.line[self.at..]);
        match rest.chars().next() {
            Some(c) if !c.is_control() => format!("'{c}'"),
            Some(c) => format!("a control character ({:#04x})", u32::from(c)),
            None => "the end of the line".to_owned(),
        }
    }

    /// A plain number: sign, digits, point, digits. No exponent.
    #[inline]
    pub(crate) fn number(&mut self) -> Read<f64> {
        let first = self.peek();
        let line = self.line;
        let start = self.at + usize::from(matches!(first, b'-' | b'+'));
        let mut mantissa = 0;
        let mut at = digits(line, start, &mut mantissa);
        let mut count = at - start;
        let mut fraction = 0;
        if line.get(at) == Some(&b'.') {
            let point = at + 1;
            at = digits(line, point, &mut mantissa);
            fraction = at - point;
            count += fraction;
        }
        let value = if (1..=18).contains(&count) && mantissa <= EXACT && !self.goes_on(at) {
            self.at = at;
            mantissa as f64 / TENS[fraction]
        } else {
            self.long_number(start)?
        };
        Ok(if first == b'-' { -value } else { value })
    }

    /// Whether a number goes on behind a blank.
    #[inline]
    fn goes_on(&self, at: usize) -> bool {
        let Some(b' ' | b'\t') = self.line.get(at) else { return false };
        let next = self.line[at..].iter().find(|byte| !matches!(byte, b' ' | b'\t'));
        matches!(next, Some(b'0'..=b'9' | b'.'))
    }

    /// A number of many digits or with blanks in it, without its sign.
    #[cold]
    fn long_number(&mut self, start: usize) -> Read<f64> {
        let mut text = String::new();
        self.at = start;
        while let Some(byte) = self.line.get(self.at) {
            match byte {
                b'0'..=b'9' => text.push(char::from(*byte)),
                b'.' if !text.contains('.') => text.push('.'),
                b' ' | b'\t' => {}
                _ => break,
            }
            self.at += 1;
        }
        if !text.bytes().any(|byte| byte.is_ascii_digit()) {
            return fault(start, format!("expected a number, found {}", self.found()));
        }
        Ok(text.parse().unwrap_or(f64::INFINITY))
    }

    /// Goes past a comment in parentheses, behind its first parenthesis.
    pub(crate) fn comment(&mut self) -> Read<()> {
        let start = self.at - 1;
        let rest = &self.line[self.at..];
        match rest.iter().position(|byte| matches!(byte, b'(' | b')')) {
            Some(length) if rest[length] == b')' => self.at += length + 1,
            Some(length) => return fault(self.at + length, "there is a comment in the comment"),
            None => return fault(start, "the comment is not closed"),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(blocks: &[&[u8]]) -> Vec<(usize, String)> {
        let mut found = Vec::new();
        let mut lines = Lines::default();
        let mut take = |n: usize, line: &[u8]| found.push((n, String::from_utf8_lossy(line).into_owned()));
        blocks.iter().for_each(|block| lines.push(block, &mut take));
        lines.finish(&mut take);
        found
    }

    #[test]
    fn every_end_of_line_ends_one_line() {
        let text = b"\xef\xbb\xbfa\r\nb\rc\n\nd";
        let expected = ["a", "b", "c", "", "d"].map(str::to_owned);
        let expected: Vec<_> = (1..).zip(expected).collect();
        assert_eq!(lines(&[text]), expected);
        let single: Vec<&[u8]> = text.chunks(1).collect();
        assert_eq!(lines(&single), expected, "in blocks of one byte");
    }

    #[test]
    fn a_line_without_an_end_takes_no_memory() {
        let mut lines = Lines::default();
        (0..100).for_each(|_| lines.push(&[b'x'; 1000], |_, _| panic!("there is no line")));
        assert!(lines.partial.len() < 2 * LINE_MAX);
        assert_eq!(lines.count(), 0);
    }

    #[test]
    fn numbers_are_read_as_floats_are() {
        for text in [
            "0",
            "1.",
            ".5",
            "-12.345",
            "+7",
            "1 2 . 5",
            "-0.1",
            "123456789012345678901234567890",
            "0.1000000000000000055",
        ] {
            let plain: f64 = text.replace(' ', "").parse().unwrap();
            let mut cursor = Cursor::new(text.as_bytes());
            assert_eq!(cursor.number().unwrap().to_bits(), plain.to_bits(), "{text}");
            assert_eq!(cursor.at, text.len());
        }
        for n in (0..2_000_000_u64).step_by(17) {
            let value = n * 49_999_999;
            let text = format!("{value}.{n}/");
            let plain: f64 = text[..text.len() - 1].parse().unwrap();
            assert_eq!(Cursor::new(text.as_bytes()).number().unwrap().to_bits(), plain.to_bits(), "{text}");
        }
        for text in ["", "-", ".", "+.", "x", "e5"] {
            assert!(Cursor::new(text.as_bytes()).number().is_err(), "{text}");
        }
        let mut cursor = Cursor::new(b"1e5");
        assert_eq!((cursor.number().unwrap(), cursor.peek()), (1.0, b'e'), "there is no exponent");
    }
}
