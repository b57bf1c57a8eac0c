//! Which dialect a program is written in.

use crate::lexer::{Cursor, Lines};

/// A dialect of G-code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dialect {
    /// RS274/NGC as LinuxCNC reads it.
    #[default]
    LinuxCnc,
    /// That of a Fanuc lathe, G-code system A.
    Fanuc,
}

impl Dialect {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LinuxCnc => "linuxcnc",
            Self::Fanuc => "fanuc",
        }
    }

    /// What the beginning of a program looks like: words that only one dialect has.
    ///
    /// LinuxCNC has O words with a keyword, named parameters, G7, G8, G64. A Fanuc lathe has the number of a program in
    /// a line of its own, tools of four digits, U and W, `G50 S`, corners with a comma. Without any of these it is
    /// LinuxCNC's.
    pub fn guess(text: &[u8]) -> Self {
        let (mut linuxcnc, mut fanuc) = (false, false);
        let mut lines = Lines::default();
        let mut look = |_: usize, line: &[u8]| {
            let (ours, theirs) = marks(line);
            linuxcnc |= ours;
            fanuc |= theirs;
        };
        lines.push(text, &mut look);
        lines.finish(&mut look);
        if fanuc && !linuxcnc { Self::Fanuc } else { Self::LinuxCnc }
    }
}

/// Whether a line is LinuxCNC's, whether it is a Fanuc's.
fn marks(line: &[u8]) -> (bool, bool) {
    let cursor = &mut Cursor::new(line);
    let (mut linuxcnc, mut fanuc) = (false, false);
    let (mut g50, mut motion, mut first) = (false, true, true);
    loop {
        let letter = cursor.peek();
        match letter {
            0 | b';' => break,
            b'(' => {
                cursor.skip();
                if cursor.comment().is_err() {
                    break;
                }
                continue;
            }
            b'#' if cursor.line.get(cursor.at + 1) == Some(&b'<') => linuxcnc = true,
            b',' => fanuc |= matches!(cursor.line.get(cursor.at + 1), Some(b'r' | b'R' | b'c' | b'C')),
            _ => {}
        }
        cursor.skip();
        let start = cursor.at;
        let number = cursor.number().ok();
        if number.is_none() {
            cursor.at = start;
        }
        let digits = cursor.line[start..cursor.at].iter().filter(|byte| byte.is_ascii_digit()).count();
        match (letter, number) {
            (b'o', Some(_)) if first => {
                let alone = matches!(cursor.peek(), 0 | b'(' | b';');
                fanuc |= alone;
                linuxcnc |= !alone;
            }
            (b'o', None) if first => linuxcnc |= matches!(cursor.peek(), b'<' | b'#' | b'['),
            (b'g', Some(code)) => {
                linuxcnc |= [7.0, 8.0, 64.0, 43.0, 49.0, 17.0].contains(&code) || code.fract() != 0.0;
                g50 |= code == 50.0;
                motion &= ![10.0, 92.0].contains(&code);
            }
            (b's', Some(_)) => fanuc |= g50,
            (b't', Some(_)) => fanuc |= digits == 4,
            (b'u' | b'w', Some(_)) => fanuc |= motion,
            _ => {}
        }
        first &= letter == b'n';
    }
    (linuxcnc, fanuc)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dialect_is_known_by_its_own_words() {
        for text in ["O0001 (SHAFT)", "G0 T0101", "G01 U-2. W-3. F0.2", "G50 S2000", "G1 X20 ,R2", "%\nO1234\nG0 X1"] {
            assert_eq!(Dialect::guess(text.as_bytes()), Dialect::Fanuc, "{text}");
        }
        for text in ["G0 X1", "o100 sub\nG0 U1", "#<a>=1", "G7 G18", "O<x> call", "(T0101) G1 X1", ""] {
            assert_eq!(Dialect::guess(text.as_bytes()), Dialect::LinuxCnc, "{text}");
        }
    }
}
