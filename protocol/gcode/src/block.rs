//! Blocks: a line's words, sorted by their letters.

use crate::expression::{Parameter, Reader, Variables, value};
use crate::finding::{Read, fault};
use crate::lexer::{Cursor, LINE_MAX};

/// A line holds at most this many G and M words.
const CODES_MAX: usize = 24;

/// A G or M word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Code {
    /// `g` or `m`.
    pub(crate) letter: u8,
    /// Its number in tenths: 921 for G92.1.
    pub(crate) tenths: u16,
    /// Where it stands.
    pub(crate) at: usize,
}

/// The words of a line. It is filled again for each line, so that no line allocates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Block {
    letters: u32,
    values: [f64; 26],
    places: [usize; 26],
    codes: [Code; CODES_MAX],
    count: usize,
    /// What the line gives to parameters, once it has been read.
    pub(crate) assignments: Vec<(Parameter, f64, usize)>,
    /// `,R` or `,C` of the Fanuc dialect: letter, value, place.
    pub(crate) corner: Option<(u8, f64, usize)>,
}

/// What a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// Words, if there are any.
    Words,
    /// `%` alone.
    Percent,
    /// An O word, which stands here.
    OWord(usize),
    /// A deleted block, or no word at all.
    Nothing,
}

const fn index(letter: u8) -> usize {
    (letter - b'a') as usize
}

/// Letters as a set.
pub(crate) const fn mask(letters: &[u8]) -> u32 {
    let (mut mask, mut nth) = (0, 0);
    while nth < letters.len() {
        mask |= 1 << index(letters[nth]);
        nth += 1;
    }
    mask
}

impl Block {
    #[inline]
    pub(crate) const fn has(&self, letter: u8) -> bool {
        self.letters & (1 << index(letter)) != 0
    }

    /// Whether it has one of the letters of this [`mask`].
    #[inline]
    pub(crate) const fn has_any(&self, mask: u32) -> bool {
        self.letters & mask != 0
    }

    #[inline]
    pub(crate) fn get(&self, letter: u8) -> Option<f64> {
        self.has(letter).then(|| self.values[index(letter)])
    }

    /// Where a word stands; the start of the line, if there is none.
    pub(crate) fn at(&self, letter: u8) -> usize {
        if self.has(letter) { self.places[index(letter)] } else { 0 }
    }

    pub(crate) fn codes(&self) -> &[Code] {
        &self.codes[..self.count]
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.letters == 0 && self.count == 0 && self.assignments.is_empty()
    }

    fn clear(&mut self) {
        (self.letters, self.count, self.corner) = (0, 0, None);
        self.assignments.clear();
    }

    /// Puts a word in its place.
    #[inline]
    pub(crate) fn put(&mut self, letter: u8, value: f64, at: usize) {
        self.letters |= 1 << index(letter);
        self.values[index(letter)] = value;
        self.places[index(letter)] = at;
    }

    /// Reads a line. Deleted blocks, which begin with a `/`, are passed over if `skip_deleted`.
    pub(crate) fn read<V: Variables>(&mut self, line: &[u8], variables: &V, skip_deleted: bool) -> Read<Content> {
        self.clear();
        if line.len() > LINE_MAX {
            return fault(LINE_MAX, format!("the line is longer than {LINE_MAX} bytes"));
        }
        let cursor = &mut Cursor::new(line);
        let mut first = true;
        let mut numbered = false;
        loop {
            let byte = cursor.peek();
            let at = cursor.at;
            match byte {
                0 if at >= line.len() => break,
                b'(' => {
                    cursor.skip();
                    cursor.comment()?;
                    continue;
                }
                b';' => break,
                b'/' if first && !numbered => {
                    if skip_deleted {
                        return Ok(Content::Nothing);
                    }
                    cursor.skip();
                    continue;
                }
                b'n' if first && !numbered => {
                    cursor.skip();
                    let number = cursor.number()?;
                    self.put(b'n', number, at);
                    numbered = true;
                    continue;
                }
                b'o' if first => return Ok(Content::OWord(at)),
                b'%' if first && !numbered => {
                    cursor.skip();
                    return if matches!(cursor.peek(), 0 | b'(' | b';') {
                        Ok(Content::Percent)
                    } else {
                        fault(at, "'%' stands alone in its line")
                    };
                }
                b'g' | b'm' => self.code(cursor, variables, byte, at)?,
                b'a'..=b'z' => {
                    cursor.skip();
                    if self.has(byte) {
                        return fault(
                            at,
                            format!("there are two {} words in the line", byte.to_ascii_uppercase() as char),
                        );
                    }
                    let value = value(cursor, variables)?;
                    self.put(byte, value, at);
                }
                b'#' => self.assignment(cursor, variables, at)?,
                b',' => self.corner(cursor, variables, at)?,
                _ => {
                    let found = cursor.found();
                    return fault(at, format!("expected a word, found {found}"));
                }
            }
            first = false;
        }
        Ok(if self.is_empty() { Content::Nothing } else { Content::Words })
    }

    #[inline]
    fn code<V: Variables>(&mut self, cursor: &mut Cursor<'_>, variables: &V, letter: u8, at: usize) -> Read<()> {
        cursor.skip();
        let number = value(cursor, variables)?;
        let exact = number * 10.0;
        // Rounded; a negative or a large number is refused below.
        let tenths = f64::from((exact + 0.5) as u16);
        if (exact - tenths).abs() > 1e-3 || !(0.0..=9999.0).contains(&exact) {
            return fault(at, format!("{}{number} is not known", letter.to_ascii_uppercase() as char));
        }
        if self.count == CODES_MAX {
            return fault(at, format!("there are more than {CODES_MAX} G and M words in the line"));
        }
        self.codes[self.count] = Code { letter, tenths: tenths as u16, at };
        self.count += 1;
        Ok(())
    }

    #[cold]
    fn assignment<V: Variables>(&mut self, cursor: &mut Cursor<'_>, variables: &V, at: usize) -> Read<()> {
        cursor.skip();
        let place = Reader { cursor, variables, depth: 0 }.place(at)?;
        if !cursor.take(b'=') {
            let found = cursor.found();
            return fault(cursor.at, format!("expected '=' behind the parameter, found {found}"));
        }
        let value = Reader { cursor, variables, depth: 0 }.given()?;
        if !value.is_finite() {
            return fault(at, "the result is not a finite number");
        }
        self.assignments.push((place, value, at));
        Ok(())
    }

    #[cold]
    fn corner<V: Variables>(&mut self, cursor: &mut Cursor<'_>, variables: &V, at: usize) -> Read<()> {
        cursor.skip();
        let letter = cursor.peek();
        if !matches!(letter, b'r' | b'c') || self.corner.is_some() {
            return fault(at, "expected one ',R' or ',C' in the line");
        }
        cursor.skip();
        self.corner = Some((letter, value(cursor, variables)?, at));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct None5;

    impl Variables for None5 {
        fn numbered(&self, _: usize) -> Option<f64> {
            Some(2.0)
        }

        fn named(&self, _: &str) -> Option<f64> {
            None
        }
    }

    fn read(line: &str) -> Result<(Block, Content), String> {
        let mut block = Block::default();
        let content = block.read(line.as_bytes(), &None5, false);
        content.map(|content| (block, content)).map_err(|fault| format!("{}: {}", fault.at, fault.message))
    }

    #[test]
    fn words_are_sorted_by_their_letters() {
        let (block, content) = read("/N10 g 0 1 X1 0.5 (Übergang) z[1+#7] M3 ;rest").unwrap();
        assert_eq!(content, Content::Words);
        let codes: Vec<_> = block.codes().iter().map(|code| (code.letter, code.tenths)).collect();
        assert_eq!(codes, [(b'g', 10), (b'm', 30)]);
        assert_eq!((block.get(b'x'), block.get(b'z'), block.get(b'y')), (Some(10.5), Some(3.0), None));
        assert_eq!(block.at(b'z'), 30);
        let (block, _) = read("#1=[2*3] #<a B>=4").unwrap();
        let named = Parameter::Named("ab".to_owned());
        assert_eq!(block.assignments, [(Parameter::Numbered(1), 6.0, 0), (named, 4.0, 9)]);
        assert_eq!(read(" % ").unwrap().1, Content::Percent);
        assert_eq!(read("N5 o100 sub").unwrap().1, Content::OWord(3));
        assert_eq!(read("(only words)").unwrap().1, Content::Nothing);
    }

    #[test]
    fn what_is_no_word_is_told_with_its_place() {
        for (line, expected) in [
            ("G1 X1 X2", "6: there are two X words in the line"),
            ("G1 X", "4: expected a number, found the end of the line"),
            ("G1 !", "3: expected a word, found '!'"),
            ("G1 (open", "3: the comment is not closed"),
            ("G1.23", "0: G1.23 is not known"),
            ("#1 z5", "3: expected '=' behind the parameter, found 'z'"),
            ("G1 \u{1}", "3: expected a word, found a control character (0x01)"),
        ] {
            assert_eq!(read(line).map(|read| read.1), Err(expected.to_owned()), "{line}");
        }
        assert!(read(&"G1 ".repeat(2000)).unwrap_err().contains("longer"));
    }
}
