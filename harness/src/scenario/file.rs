//! Scenario files (TOML).

use std::path::Path;

use serde::Deserialize;
use toml::Spanned;
use torno_protocol::lathe::Program;
use torno_protocol::time::{Instant, Span};

use super::{Action, Claim, Condition, PATIENCE, Scenario, Step, Trigger};
use crate::fault::{Fault, Names, RawFault, span};
use crate::rig::file::{RigFile, RigFileError};
use crate::text::{self, Complaint, Invalid, TextError, nearest};

/// A scenario ends at the latest so long after it has begun, if nothing else is said.
const END: Span = Span::from_secs(1_000);

/// Why a scenario cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("{path}: cannot read the scenario")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        source: TextError,
    },
    /// It is not a scenario.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// Its rig is none.
    #[error(transparent)]
    Rig(#[from] RigFileError),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScenario {
    name: String,
    #[serde(default = "default_rig")]
    rig: String,
    #[serde(default)]
    set: Vec<Spanned<String>>,
    #[serde(default)]
    seed: u64,
    #[serde(default = "yes")]
    held: bool,
    end: Option<Spanned<String>>,
    #[serde(default)]
    step: Vec<Spanned<RawStep>>,
    #[serde(default)]
    fault: Vec<RawFault>,
    #[serde(default)]
    expect: RawExpect,
}

fn default_rig() -> String {
    crate::rig::file::DEFAULT.to_owned()
}

const fn yes() -> bool {
    true
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawStep {
    does: String,
    send: Option<Vec<Spanned<String>>>,
    bytes: Option<Spanned<String>>,
    run: Option<Spanned<String>>,
    wait: Option<RawCondition>,
    r#break: Option<RawFault>,
    heal: Option<Spanned<String>>,
    check: Option<RawClaim>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawExpect {
    replies: Option<String>,
    #[serde(default)]
    finally: Vec<RawClaim>,
    #[serde(default)]
    always: Vec<RawClaim>,
    #[serde(default)]
    never: Vec<RawCondition>,
}

/// A condition as a file says it.
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
    equals: Option<i64>,
    at_least: Option<i64>,
    at_most: Option<i64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawClaim {
    board: Spanned<String>,
    quantity: Spanned<String>,
    equals: Option<i64>,
    at_least: Option<i64>,
    at_most: Option<i64>,
}

impl Scenario {
    /// Reads a scenario file. A `seed` takes the place of the file's.
    ///
    /// # Errors
    /// [`ScenarioError`]: where, what was expected, what was found.
    pub fn load(path: &Path, seed: Option<u64>) -> Result<Self, ScenarioError> {
        let name = path.display().to_string();
        match text::read(path) {
            Ok(text) => Self::parse(&name, &text, seed),
            Err(source) => Err(ScenarioError::Unreadable { path: name, source }),
        }
    }

    /// Reads a scenario's text. `path` is for the messages; a rig file is looked for beside it.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn parse(path: &str, text: &str, seed: Option<u64>) -> Result<Self, ScenarioError> {
        let invalid = |(span, message): Complaint| Invalid::at(path, text, span, message);
        let of_toml = |error: toml::de::Error| invalid(text::of_toml(&error));
        let mut raw: RawScenario = toml::from_str(text).map_err(of_toml)?;
        raw.seed = seed.unwrap_or(raw.seed);
        let beside = Path::new(path).parent().map(|folder| folder.join(&raw.rig)).filter(|rig| rig.is_file());
        let rig = beside.map_or_else(|| raw.rig.clone(), |rig| rig.display().to_string());
        let mut file = RigFile::load(&rig)?;
        for set in &raw.set {
            file = file.set(set.get_ref()).map_err(|message| invalid((set.span(), message)))?;
        }
        Ok(Self::check(raw, file, rig).map_err(invalid)?)
    }

    fn check(raw: RawScenario, file: RigFile, rig: String) -> Result<Self, Complaint> {
        let names = Names::of(&file);
        let seed = raw.seed;
        let mut known: Vec<Fault> = Vec::new();
        let mut faults = Vec::new();
        for (number, raw) in raw.fault.iter().enumerate() {
            let fault = raw.check(&names, number, seed)?;
            let trigger = match (&raw.at, &raw.when) {
                (Some(at), None) => Trigger::At(Instant::START + span(at)?),
                (None, Some(when)) => Trigger::When(when.check(&names)?),
                (None, None) => Trigger::At(Instant::START),
                (Some(at), Some(_)) => return Err((at.span(), "expected either at or when, not both".to_owned())),
            };
            known.push(fault.clone());
            faults.push((trigger, fault));
        }
        let mut steps = Vec::new();
        for (number, step) in raw.step.into_iter().enumerate() {
            let place = step.span();
            let step = step.into_inner();
            let action = step.check(&names, &known, number + faults.len(), seed, place)?;
            if let Action::Break(fault) = &action {
                known.push(fault.clone());
            }
            steps.push(Step { does: step.does, action });
        }
        let claims = |raw: &[RawClaim]| raw.iter().map(|claim| claim.check(&names)).collect::<Result<Vec<_>, _>>();
        Ok(Self {
            name: raw.name,
            rig,
            file,
            seed,
            held: raw.held,
            steps,
            faults,
            finally: claims(&raw.expect.finally)?,
            always: claims(&raw.expect.always)?,
            replies: raw.expect.replies.as_deref().map(words),
            never: raw.expect.never.iter().map(|never| never.check(&names)).collect::<Result<_, _>>()?,
            end: raw.end.as_ref().map_or(Ok(END), span)?,
        })
    }
}

/// Replies in a row, each with its letters: `ACK`, `NAK o`, `CAN d n`.
pub(super) fn words(text: &str) -> Vec<String> {
    let mut replies: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match replies.last_mut() {
            Some(last) if word.len() == 1 && word.chars().all(|c| c.is_ascii_lowercase()) => {
                last.push(' ');
                last.push_str(word);
            }
            _ => replies.push(word.to_owned()),
        }
    }
    replies
}

impl RawStep {
    fn check(
        &self,
        names: &Names,
        known: &[Fault],
        number: usize,
        seed: u64,
        place: std::ops::Range<usize>,
    ) -> Result<Action, Complaint> {
        let mut actions = Vec::new();
        if let Some(frames) = &self.send {
            let mut bytes = Vec::new();
            for frame in frames {
                let program = Program::parse(frame.get_ref()).map_err(|error| (frame.span(), error.to_string()))?;
                bytes.extend(program.bytes());
            }
            actions.push(Action::Send(bytes));
        }
        if let Some(bytes) = &self.bytes {
            let byte = |word: &str| u8::from_str_radix(word, 16).ok().filter(|_| word.len() == 2);
            let bytes: Option<Vec<u8>> = bytes.get_ref().split_whitespace().map(byte).collect();
            let wrong =
                || (self.bytes.as_ref().map_or(0..0, Spanned::span), "expected bytes of two hex digits".to_owned());
            actions.push(Action::Send(bytes.ok_or_else(wrong)?));
        }
        if let Some(run) = &self.run {
            actions.push(Action::Run(span(run)?));
        }
        if let Some(wait) = &self.wait {
            actions.push(Action::Wait(wait.check(names)?, wait.within.as_ref().map_or(Ok(PATIENCE), span)?));
        }
        if let Some(fault) = &self.r#break {
            if let Some(at) = &fault.at {
                return Err((at.span(), "a step breaks something when its turn comes: expected no at here".to_owned()));
            }
            actions.push(Action::Break(fault.check(names, number, seed)?));
        }
        if let Some(name) = &self.heal {
            let Some(fault) = known.iter().rfind(|fault| fault.name == *name.get_ref()) else {
                let known: Vec<&str> = known.iter().map(|fault| fault.name.as_str()).collect();
                let message =
                    format!("there is no fault '{}' by now{}", name.get_ref(), nearest(name.get_ref(), &known));
                return Err((name.span(), message));
            };
            if let Some(lasts) = fault.lasts {
                let message = format!("'{}' ends by itself, after {lasts}: expected a fault without for", fault.name);
                return Err((name.span(), message));
            }
            actions.push(Action::Heal(name.get_ref().clone()));
        }
        if let Some(claim) = &self.check {
            actions.push(Action::Check(claim.check(names)?));
        }
        let found = actions.len();
        match <[Action; 1]>::try_from(actions) {
            Ok([action]) => Ok(action),
            Err(_) => {
                let message = "expected one of send, bytes, run, wait, break, heal, check in this step";
                Err((place, format!("{message}, found {found}")))
            }
        }
    }
}

impl RawCondition {
    fn check(&self, names: &Names) -> Result<Condition, Complaint> {
        if let Some(nth) = self.character.as_ref().filter(|nth| self.line.is_none() || *nth.get_ref() == 0) {
            return Err((nth.span(), "character: expected which one of a line, from 1".to_owned()));
        }
        match self {
            Self { reply: Some(reply), line: None, board: None, .. } => {
                let text = words(reply.get_ref()).join(" ");
                let known = ["ACK", "XOFF", "XON", "NAK", "CAN"];
                let first = text.split(' ').next().unwrap_or_default();
                if !known.contains(&first) {
                    let message = format!("there is no reply '{}'{}", reply.get_ref(), nearest(first, &known));
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
    fn check(&self, names: &Names) -> Result<Claim, Complaint> {
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
