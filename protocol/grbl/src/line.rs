//! Lines, as the firmware makes them of the characters in its receive buffer.

/// The longest line, without what is left out of it.
const LONGEST: usize = 79;

/// What comes between a line's characters and is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Skipping {
    #[default]
    Nothing,
    /// Until the bracket closes.
    Comment,
    /// Until the line ends.
    Rest,
    /// Until the line ends: it is too long.
    Overflow,
}

/// A line that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum TextLine {
    /// Without blanks and comments, in capitals.
    Text(Vec<u8>),
    TooLong,
}

/// Makes lines of characters.
#[derive(Clone, Debug, Default)]
pub(crate) struct LineReader {
    text: Vec<u8>,
    skipping: Skipping,
}

impl LineReader {
    /// Takes a character. CR and LF each end a line.
    pub(crate) fn take(&mut self, c: u8) -> Option<TextLine> {
        match (self.skipping, c) {
            (skipping, b'\n' | b'\r') => {
                let text = core::mem::take(&mut self.text);
                self.skipping = Skipping::Nothing;
                return Some(if skipping == Skipping::Overflow { TextLine::TooLong } else { TextLine::Text(text) });
            }
            (Skipping::Comment, b')') => self.skipping = Skipping::Nothing,
            (Skipping::Comment | Skipping::Rest | Skipping::Overflow, _) | (_, 0..=b' ' | b'/') => {}
            (_, b'(') => self.skipping = Skipping::Comment,
            (_, b';') => self.skipping = Skipping::Rest,
            _ if self.text.len() >= LONGEST => self.skipping = Skipping::Overflow,
            _ => self.text.push(c.to_ascii_uppercase()),
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<TextLine> {
        let mut reader = LineReader::default();
        text.bytes().filter_map(|c| reader.take(c)).collect()
    }

    fn text(text: &str) -> TextLine {
        TextLine::Text(text.as_bytes().to_vec())
    }

    #[test]
    fn blanks_and_comments_are_left_out() {
        assert_eq!(lines("g1 x 1 (feed) y2 ; rest\n"), [text("G1X1Y2")]);
        assert_eq!(lines("/G0X0\r\n"), [text("G0X0"), text("")]);
        assert_eq!(lines("G0X0(a(b)c)Y1\n"), [text("G0X0C)Y1")]);
    }

    #[test]
    fn a_line_of_eighty_characters_is_too_long() {
        let line = |n| lines(&format!("{}\n", "X".repeat(n)));
        assert_eq!(line(79), [text(&"X".repeat(79))]);
        assert_eq!(line(80), [TextLine::TooLong]);
        assert_eq!(lines(&format!("{}({})\n", "X".repeat(79), "c".repeat(200))).len(), 1);
    }
}
