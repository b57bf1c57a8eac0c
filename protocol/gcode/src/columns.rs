//! Where words stand: for what is known of a line only after it has been read.

use crate::finding::column;
use crate::lexer::{Cursor, Lines};

/// Looks up the columns of words, in a second reading of a text.
#[derive(Clone, Debug)]
pub struct Columns {
    lines: Lines,
    /// The line and the letter of each word, and its column once that is known.
    words: Vec<(usize, u8, usize)>,
}

impl Columns {
    /// Looks for words: the line of each, from 1, and its letter in lower case.
    pub fn new(words: impl IntoIterator<Item = (usize, u8)>) -> Self {
        let words = words.into_iter().map(|(line, letter)| (line, letter, 1)).collect();
        Self { lines: Lines::default(), words }
    }

    /// Takes the next bytes of the text, cut anywhere.
    pub fn push(&mut self, bytes: &[u8]) {
        let Self { lines, words } = self;
        lines.push(bytes, |number, line| look(words, number, line));
    }

    /// At the end of the text: the columns, from 1, in the order of the words. That of a word which is not in its line
    /// is the column where the line begins.
    pub fn finish(mut self) -> Vec<usize> {
        let Self { lines, words } = &mut self;
        lines.finish(|number, line| look(words, number, line));
        self.words.into_iter().map(|word| word.2).collect()
    }
}

fn look(words: &mut [(usize, u8, usize)], number: usize, line: &[u8]) {
    for (_, letter, found) in words.iter_mut().filter(|word| word.0 == number) {
        // In a Fanuc's program, relative words have letters of their own.
        let other = match *letter {
            b'x' => b'u',
            b'z' => b'w',
            letter => letter,
        };
        let at = at(line, *letter).or_else(|| at(line, other));
        let first = || line.iter().position(|byte| !matches!(byte, b' ' | b'\t')).unwrap_or(0);
        *found = column(line, at.unwrap_or_else(first));
    }
}

/// Where the word with this letter stands: not in a comment, not in an expression, not in a name.
fn at(line: &[u8], letter: u8) -> Option<usize> {
    let cursor = &mut Cursor::new(line);
    let mut depth = 0_u32;
    loop {
        match cursor.peek() {
            0 | b';' => return None,
            b'(' => {
                cursor.skip();
                cursor.comment().ok()?;
                continue;
            }
            b'[' => depth += 1,
            b']' => depth = depth.saturating_sub(1),
            b'<' => {
                while !matches!(cursor.peek(), 0 | b'>') {
                    cursor.skip();
                }
            }
            byte if byte == letter && depth == 0 => return Some(cursor.at),
            _ => {}
        }
        cursor.skip();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_found_where_they_stand() {
        let text = b"G0 (x) X1\r\n\tn5 g1 x[#<x>+2] f60\n  G1 U-1 ; w\n";
        let words = [(1, b'x'), (2, b'f'), (2, b'x'), (3, b'x'), (3, b'z'), (4, b'g')];
        for cut in 0..text.len() {
            let mut columns = Columns::new(words);
            columns.push(&text[..cut]);
            columns.push(&text[cut..]);
            assert_eq!(columns.finish(), [8, 18, 8, 6, 3, 1]);
        }
    }
}
