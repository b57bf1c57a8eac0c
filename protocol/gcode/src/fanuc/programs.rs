//! Where the programs and the blocks of a Fanuc's text begin.

use std::collections::BTreeMap;

use crate::block::Block;
use crate::lexer::Cursor;

/// Whether a line needs lines elsewhere in the text: M98, or a cycle with a contour.
pub(crate) fn goes_elsewhere(block: &Block) -> bool {
    block.codes().iter().any(|code| match (code.letter, code.tenths) {
        (b'm', 980) => true,
        (b'g', 700 | 710 | 720 | 730) => block.has(b'p'),
        _ => false,
    })
}

/// The programs of a text and its numbered blocks, by the number of their line.
#[derive(Clone, Debug, Default)]
pub(crate) struct Programs {
    starts: BTreeMap<u32, usize>,
    blocks: BTreeMap<u32, Vec<usize>>,
}

impl Programs {
    pub(crate) fn of<'a>(lines: impl Iterator<Item = &'a [u8]>) -> Self {
        let mut programs = Self::default();
        for (nth, line) in lines.enumerate() {
            let cursor = &mut Cursor::new(line);
            let letter = cursor.peek();
            cursor.skip();
            let number = matches!(letter, b'o' | b'n').then(|| cursor.number().ok()).flatten();
            let Some(number) = number.filter(|number| number.fract() == 0.0 && (0.0..1e9).contains(number)) else {
                continue;
            };
            if letter == b'o' {
                programs.starts.entry(number as u32).or_insert(nth + 1);
            } else {
                programs.blocks.entry(number as u32).or_default().push(nth);
            }
        }
        programs
    }

    /// The first line of a program.
    pub(crate) fn start(&self, program: u32) -> Option<usize> {
        self.starts.get(&program).copied()
    }

    /// The lines of a contour: the next one from a line on; if there is none, the last one before it.
    pub(crate) fn contour(&self, [from, to]: [u32; 2], line: usize) -> Option<(usize, usize)> {
        let starts = self.blocks.get(&from)?;
        let next = starts.iter().find(|start| **start >= line).or(starts.last())?;
        let end = self.blocks.get(&to)?.iter().find(|end| *end >= next)?;
        Some((*next, *end))
    }
}
