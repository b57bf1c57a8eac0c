//! Conditions as files say them.

use std::ops::Range;

use serde::Deserialize;
use toml::{Spanned, Value};
use torno_protocol::time::Span;

use super::{Claim, Condition};
use torno_bus::{Dialect, Names};
use torno_text::{Complaint, nearest, span};

/// A condition as a file says it: one of [`KINDS`], and what belongs to it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawCondition {
    within: Option<Spanned<String>>,
    reply: Option<Spanned<String>>,
    line: Option<Spanned<String>>,
    character: Option<Spanned<u64>>,
    board: Option<Spanned<String>>,
    event: Option<Spanned<String>>,
    quantity: Option<Spanned<String>>,
    equals: Option<Spanned<Value>>,
    at_least: Option<Spanned<Value>>,
    at_most: Option<Spanned<Value>>,
    part: Option<Spanned<String>>,
}

/// What a condition can be about, and the fields that it has then beyond its own.
const KINDS: [(&str, &[&str]); 5] = [
    ("reply", &[]),
    ("line", &["character"]),
    ("event", &["board"]),
    ("quantity", &["board", "equals", "at_least", "at_most"]),
    ("part", &[]),
];

/// Replies in a row, each with its letters and numbers: `ACK`, `NAK o`, `CAN d n`, `KX 20`.
fn words(text: &str) -> Vec<String> {
    let mut replies: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match replies.last_mut() {
            Some(last) if is_rest(word) => {
                last.push(' ');
                last.push_str(word);
            }
            _ => replies.push(word.to_owned()),
        }
    }
    replies
}

/// A letter or a number belongs to the word before it.
fn is_rest(word: &str) -> bool {
    matches!(word.as_bytes(), [letter] if letter.is_ascii_lowercase()) || word.parse::<i64>().is_ok()
}

/// Replies in a row, all of which the PC can hear.
///
/// # Errors
/// Where, what was expected, what was found.
pub(crate) fn replies(text: &Spanned<String>, dialect: &dyn Dialect) -> Result<Vec<String>, Complaint> {
    let words = words(text.get_ref());
    words.iter().try_for_each(|reply| dialect.check_reply(reply)).map_err(|message| (text.span(), message))?;
    Ok(words)
}

impl RawCondition {
    /// What it is about, and where that stands.
    ///
    /// # Errors
    /// It is about nothing, or about several things.
    fn kind(&self) -> Result<(&'static str, Range<usize>), Complaint> {
        let found: Vec<_> = self.fields().filter(|(name, _)| KINDS.iter().any(|(kind, _)| kind == name)).collect();
        match &found[..] {
            [one] => Ok(one.clone()),
            [] => {
                let place = self.fields().map(|(_, place)| place).next().unwrap_or(0..0);
                let message = "expected a reply; or a line and a character; or a board with an event or a quantity";
                Err((place, message.to_owned()))
            }
            [(first, _), (second, place), ..] => {
                Err((place.clone(), format!("{second}: expected either this or {first}, not both")))
            }
        }
    }

    /// What it says, and where.
    fn fields(&self) -> impl Iterator<Item = (&'static str, Range<usize>)> {
        fn place<T>(field: Option<&Spanned<T>>) -> Option<Range<usize>> {
            field.map(Spanned::span)
        }
        let fields = [
            ("reply", place(self.reply.as_ref())),
            ("line", place(self.line.as_ref())),
            ("event", place(self.event.as_ref())),
            ("quantity", place(self.quantity.as_ref())),
            ("part", place(self.part.as_ref())),
            ("character", place(self.character.as_ref())),
            ("board", place(self.board.as_ref())),
            ("equals", place(self.equals.as_ref())),
            ("at_least", place(self.at_least.as_ref())),
            ("at_most", place(self.at_most.as_ref())),
            ("within", place(self.within.as_ref())),
        ];
        fields.into_iter().filter_map(|(name, place)| Some((name, place?)))
    }

    /// Refuses what means nothing to a condition of this kind.
    fn check_fields(&self, kind: &str) -> Result<(), Complaint> {
        let own = KINDS.iter().find(|(name, _)| *name == kind).map_or(&[][..], |(_, own)| own);
        match self.fields().find(|(name, _)| *name != kind && !own.contains(name)) {
            None => Ok(()),
            Some(("within", place)) => {
                let message = "within: only a step that waits has so much time: expected none here";
                Err((place, message.to_owned()))
            }
            Some((name, place)) if own.is_empty() => {
                Err((place, format!("{name}: means nothing beside {kind}: expected {kind} alone")))
            }
            Some((name, place)) => {
                Err((place, format!("{name}: means nothing beside {kind}: expected {kind} and {}", own.join(", "))))
            }
        }
    }

    /// The event of the part, if it is about that.
    ///
    /// # Errors
    /// It is about something else, too.
    pub(crate) fn of_part(&self) -> Result<Option<&Spanned<String>>, Complaint> {
        if self.part.is_some() {
            let (kind, _) = self.kind()?;
            self.check_fields(kind)?;
        }
        Ok(self.part.as_ref())
    }

    /// Within what the part must be as asked, if it is about that.
    ///
    /// # Errors
    /// It is about something else, too, or does not say within what.
    pub(crate) fn of_whole_part(&self) -> Result<Option<&Spanned<String>>, Complaint> {
        let Some(part) = &self.part else { return Ok(None) };
        Self { within: None, ..self.clone() }.of_part()?;
        if part.get_ref() != "as asked" {
            return Err((part.span(), format!("'{}': expected \"as asked\", the whole part, here", part.get_ref())));
        }
        let complaint = || (part.span(), "part: expected how near it must be, such as within = \"0.05 mm\"".to_owned());
        self.within.as_ref().ok_or_else(complaint).map(Some)
    }

    /// What a step waits for, and for how long if it says so.
    ///
    /// # Errors
    /// Where, what was expected, what was found.
    pub(crate) fn awaited(&self, names: &Names) -> Result<(Condition, Option<Span>), Complaint> {
        let Some(text) = &self.within else { return Ok((self.check(names)?, None)) };
        let within = span(text)?;
        if within == Span::ZERO {
            return Err((text.span(), "within: nothing comes in no time: expected a time above 0".to_owned()));
        }
        let condition = Self { within: None, ..self.clone() };
        Ok((condition.check(names)?, Some(within)))
    }

    /// The condition, in a rig with these names.
    ///
    /// # Errors
    /// Where, what was expected, what was found.
    pub(crate) fn check(&self, names: &Names) -> Result<Condition, Complaint> {
        let (kind, place) = self.kind()?;
        if kind == "part" {
            let message = "part: the part is cut when all is done: expected this alone, in expect.never";
            return Err((place, message.to_owned()));
        }
        self.check_fields(kind)?;
        match self {
            Self { reply: Some(reply), .. } => match &replies(reply, names.dialect)?[..] {
                [one] => Ok(Condition::Reply(one.clone())),
                several => Err((reply.span(), format!("expected one reply, found {}", several.len()))),
            },
            Self { line: Some(line), .. } => {
                let (node, port) = names.senders[names.line(line)?];
                let nth = self.character.as_ref().map_or(1, |nth| *nth.get_ref());
                if let Some(wrong) = self.character.as_ref().filter(|_| nth == 0) {
                    return Err((wrong.span(), "character: expected which one of a line, from 1".to_owned()));
                }
                Ok(Condition::Character { node, port, nth, line: line.get_ref().clone() })
            }
            Self { event: Some(event), .. } => {
                let board = self.board.as_ref().ok_or_else(|| (place, "event: expected its board, too".to_owned()))?;
                let node = names.board(board)?;
                let known: Vec<&str> = names.descriptions[node].events.iter().map(String::as_str).collect();
                let found = known.iter().position(|text| text == event.get_ref());
                let number = found.ok_or_else(|| {
                    let message = format!("'{}' has no event '{}'", board.get_ref(), event.get_ref());
                    (event.span(), message + &nearest(event.get_ref(), &known))
                })?;
                Ok(Condition::Event { node, event: number as u8, text: event.get_ref().clone() })
            }
            _ => Ok(Condition::Value(self.claim(names)?)),
        }
    }

    /// The bounds of a quantity, in a rig with these names.
    ///
    /// # Errors
    /// Where, what was expected, what was found.
    pub(crate) fn claim(&self, names: &Names) -> Result<Claim, Complaint> {
        let Some(quantity) = &self.quantity else {
            let place = self.fields().map(|(_, place)| place).next().unwrap_or(0..0);
            return Err((place, "expected a quantity of a board, and its bounds".to_owned()));
        };
        let (kind, _) = self.kind()?;
        self.check_fields(kind)?;
        let wrong = |message: &str| (quantity.span(), message.to_owned());
        let board = self.board.as_ref().ok_or_else(|| wrong("quantity: expected its board, too"))?;
        let node = names.board(board)?;
        let signal = names.signal(node, quantity)?;
        let unit =
            Some(names.descriptions[node].signals[usize::from(signal)].unit.as_str()).filter(|unit| !unit.is_empty());
        let bound =
            |bound: &Option<Spanned<Value>>| bound.as_ref().map(|bound| number(bound, quantity, unit)).transpose();
        let (least, most) = match (bound(&self.equals)?, bound(&self.at_least)?, bound(&self.at_most)?) {
            (Some(value), None, None) => (value, value),
            (None, None, None) | (Some(_), ..) => return Err(wrong("expected equals, or at_least, at_most or both")),
            (None, least, most) => (least.unwrap_or(i64::MIN), most.unwrap_or(i64::MAX)),
        };
        let name = format!("{}.{}", board.get_ref(), quantity.get_ref());
        if least > most {
            return Err(wrong(&format!("{name}: at_least is above at_most: nothing can be both")));
        }
        Ok(Claim { node, signal, least, most, name })
    }
}

/// A bound: a whole number, or one with the unit that the quantity has: `200`, `"200 rpm"`.
fn number(bound: &Spanned<Value>, quantity: &Spanned<String>, unit: Option<&str>) -> Result<i64, Complaint> {
    let wrong = |why: &str| {
        let expected = match unit {
            Some(unit) => format!("expected a whole number of {unit}, such as 200 or \"200 {unit}\""),
            None => format!("'{}' has no unit: expected a whole number, such as 1", quantity.get_ref()),
        };
        Err((bound.span(), format!("{}: {expected}{why}", bound.get_ref())))
    };
    let is_near = |nearest: &String| nearest.contains("did you mean");
    match bound.get_ref() {
        Value::Integer(value) => Ok(*value),
        Value::String(text) => {
            let end = text.find(|c: char| !matches!(c, '0'..='9' | '-' | '+')).unwrap_or(text.len());
            let (value, found) = (text[..end].parse(), text[end..].trim());
            match (value, unit) {
                (Ok(value), Some(unit)) if unit == found => Ok(value),
                (Ok(_), Some(unit)) => wrong(&Some(nearest(found, &[unit])).filter(is_near).unwrap_or_default()),
                _ => wrong(""),
            }
        }
        _ => wrong(""),
    }
}
