//! Conditions as files say them.

use serde::Deserialize;
use toml::Spanned;

use super::{Claim, Condition};
use crate::rig::names::Names;
use crate::text::{Complaint, nearest};

/// A condition as a file says it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawCondition {
    pub(crate) within: Option<Spanned<String>>,
    reply: Option<Spanned<String>>,
    line: Option<Spanned<String>>,
    character: Option<Spanned<u64>>,
    board: Option<Spanned<String>>,
    event: Option<Spanned<String>>,
    quantity: Option<Spanned<String>>,
    equals: Option<i64>,
    at_least: Option<i64>,
    at_most: Option<i64>,
    part: Option<Spanned<String>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawClaim {
    board: Spanned<String>,
    quantity: Spanned<String>,
    equals: Option<i64>,
    at_least: Option<i64>,
    at_most: Option<i64>,
}

/// Replies in a row, each with its letters and numbers: `ACK`, `NAK o`, `CAN d n`, `KX 20`.
pub(crate) fn words(text: &str) -> Vec<String> {
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

impl RawCondition {
    /// The event of the part, if that is what it says, and nothing else.
    pub(crate) fn of_part(&self) -> Option<&Spanned<String>> {
        let others = [&self.reply, &self.line, &self.board, &self.event, &self.quantity, &self.within];
        self.part.as_ref().filter(|_| others.into_iter().all(Option::is_none) && self.character.is_none())
    }

    /// The condition, in a rig with these names.
    ///
    /// # Errors
    /// Where, what was expected, what was found.
    pub(crate) fn check(&self, names: &Names) -> Result<Condition, Complaint> {
        if let Some(nth) = self.character.as_ref().filter(|nth| self.line.is_none() || *nth.get_ref() == 0) {
            return Err((nth.span(), "character: expected which one of a line, from 1".to_owned()));
        }
        if let Some(part) = &self.part {
            let message = "part: the part is cut when all is done: expected this alone, in expect.never";
            return Err((part.span(), message.to_owned()));
        }
        match self {
            Self { reply: Some(reply), line: None, board: None, .. } => {
                let text = words(reply.get_ref()).join(" ");
                let known = names.dialect.replies();
                let first = text.split(' ').next().unwrap_or_default();
                if !known.contains(&first) {
                    let message = format!("there is no reply '{}'{}", reply.get_ref(), nearest(first, known));
                    return Err((reply.span(), message));
                }
                Ok(Condition::Reply(text))
            }
            Self { line: Some(line), reply: None, board: None, .. } => {
                let (node, port) = names.senders[names.line(line)?];
                let nth = self.character.as_ref().map_or(1, |nth| *nth.get_ref());
                Ok(Condition::Character { node, port, nth, line: line.get_ref().clone() })
            }
            Self { board: Some(board), event: Some(event), quantity: None, .. } => {
                let node = names.board(board)?;
                let known: Vec<&str> = names.events[node].iter().map(String::as_str).collect();
                let found = known.iter().position(|text| text == event.get_ref());
                let number = found.ok_or_else(|| {
                    let message = format!("'{}' has no event '{}'", board.get_ref(), event.get_ref());
                    (event.span(), message + &nearest(event.get_ref(), &known))
                })?;
                Ok(Condition::Event { node, event: number as u8, text: event.get_ref().clone() })
            }
            Self { board: Some(board), quantity: Some(quantity), event: None, .. } => {
                let (equals, at_least, at_most) = (self.equals, self.at_least, self.at_most);
                let claim = RawClaim { board: board.clone(), quantity: quantity.clone(), equals, at_least, at_most };
                Ok(Condition::Value(claim.check(names)?))
            }
            _ => {
                let place = [&self.reply, &self.line, &self.board, &self.event, &self.quantity];
                let place = place.into_iter().flatten().map(Spanned::span).next().unwrap_or(0..0);
                let message = "expected a reply; or a line and a character; or a board with an event or a quantity";
                Err((place, message.to_owned()))
            }
        }
    }
}

impl RawClaim {
    /// The claim, in a rig with these names.
    ///
    /// # Errors
    /// Where, what was expected, what was found.
    pub(crate) fn check(&self, names: &Names) -> Result<Claim, Complaint> {
        let node = names.board(&self.board)?;
        let signal = names.signal(node, &self.quantity)?;
        let (least, most) = match (self.equals, self.at_least, self.at_most) {
            (Some(value), None, None) => (value, value),
            (None, None, None) | (Some(_), ..) => {
                return Err((self.quantity.span(), "expected equals, or at_least, at_most or both".to_owned()));
            }
            (None, least, most) => (least.unwrap_or(i64::MIN), most.unwrap_or(i64::MAX)),
        };
        let name = format!("{}.{}", self.board.get_ref(), self.quantity.get_ref());
        if least > most {
            return Err((self.quantity.span(), format!("{name}: at_least is above at_most: nothing can be both")));
        }
        Ok(Claim { node, signal, least, most, name })
    }
}
