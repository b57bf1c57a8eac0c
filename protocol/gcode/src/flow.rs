//! O words of LinuxCNC: subroutines, conditions, loops.

use std::collections::BTreeMap;

use crate::expression::{Reader, Variables, value};
use crate::finding::{Read, fault};
use crate::lexer::Cursor;

/// What an O word does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Keyword {
    Sub,
    EndSub,
    Call,
    Return,
    If,
    ElseIf,
    Else,
    EndIf,
    While,
    EndWhile,
    Do,
    Repeat,
    EndRepeat,
    Break,
    Continue,
}

/// In an order in which no word begins another that follows it.
const KEYWORDS: [(&[u8], Keyword); 15] = [
    (b"sub", Keyword::Sub),
    (b"endsub", Keyword::EndSub),
    (b"call", Keyword::Call),
    (b"return", Keyword::Return),
    (b"if", Keyword::If),
    (b"elseif", Keyword::ElseIf),
    (b"else", Keyword::Else),
    (b"endif", Keyword::EndIf),
    (b"while", Keyword::While),
    (b"endwhile", Keyword::EndWhile),
    (b"do", Keyword::Do),
    (b"repeat", Keyword::Repeat),
    (b"endrepeat", Keyword::EndRepeat),
    (b"break", Keyword::Break),
    (b"continue", Keyword::Continue),
];

/// A label: `o100`, `o<name>`.
pub(crate) type Label = String;

/// Reads the label and the keyword of a line; what follows is left at the cursor.
pub(crate) fn head<V: Variables>(cursor: &mut Cursor<'_>, variables: &V) -> Read<(Label, Keyword)> {
    let at = cursor.at;
    cursor.skip();
    let label = if cursor.take(b'<') {
        let name = Reader { cursor, variables, depth: 0 }.name(at)?;
        format!("<{name}>")
    } else {
        let number = match cursor.peek() {
            b'0'..=b'9' => cursor.number()?,
            _ => value(cursor, variables)?,
        };
        if number.fract() != 0.0 || !(0.0..=1e9).contains(&number) {
            return fault(at, format!("the number of an O word is whole; it is {number}"));
        }
        format!("{number}")
    };
    for (word, keyword) in KEYWORDS {
        if cursor.take_word(word) {
            return Ok((label, keyword));
        }
    }
    let found = cursor.found();
    fault(cursor.at, format!("expected sub, call, if, while, do, repeat… behind the O word, found {found}"))
}

/// The values in brackets behind a keyword.
pub(crate) fn arguments<V: Variables>(cursor: &mut Cursor<'_>, variables: &V) -> Read<Vec<f64>> {
    let mut values = Vec::new();
    while cursor.peek() == b'[' {
        if values.len() == crate::machine::LOCALS {
            return fault(cursor.at, "a call takes at most 30 values");
        }
        values.push(value(cursor, variables)?);
    }
    match cursor.peek() {
        0 | b';' | b'(' => Ok(values),
        _ => {
            let found = cursor.found();
            fault(cursor.at, format!("expected '[' or the end of the line, found {found}"))
        }
    }
}

/// An O word of the text.
#[derive(Clone, Debug)]
pub(crate) struct Mark {
    /// Which line of the text.
    pub(crate) line: usize,
    pub(crate) label: Label,
    pub(crate) keyword: Keyword,
}

/// Where the O words of a text are.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marks {
    marks: Vec<Mark>,
    /// By line.
    of_line: BTreeMap<usize, usize>,
    /// By label, in the order of lines.
    of_label: BTreeMap<Label, Vec<usize>>,
}

impl Marks {
    pub(crate) fn push(&mut self, mark: Mark) {
        let number = self.marks.len();
        self.of_line.insert(mark.line, number);
        self.of_label.entry(mark.label.clone()).or_default().push(number);
        self.marks.push(mark);
    }

    /// The first mark with this label behind a line, that is one of these.
    pub(crate) fn behind(&self, label: &str, line: usize, wanted: &[Keyword]) -> Option<&Mark> {
        let of_label = self.of_label.get(label)?;
        let from = of_label.partition_point(|mark| self.marks[*mark].line <= line);
        of_label[from..].iter().map(|mark| &self.marks[*mark]).find(|mark| wanted.contains(&mark.keyword))
    }

    /// The last mark with this label before a line, that is one of these.
    pub(crate) fn before(&self, label: &str, line: usize, wanted: &[Keyword]) -> Option<&Mark> {
        let of_label = self.of_label.get(label)?;
        let upto = of_label.partition_point(|mark| self.marks[*mark].line < line);
        of_label[..upto].iter().rev().map(|mark| &self.marks[*mark]).find(|mark| wanted.contains(&mark.keyword))
    }

    /// Where a subroutine begins.
    pub(crate) fn sub(&self, label: &str) -> Option<&Mark> {
        let of_label = self.of_label.get(label)?;
        of_label.iter().map(|mark| &self.marks[*mark]).find(|mark| mark.keyword == Keyword::Sub)
    }
}
