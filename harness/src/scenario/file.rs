//! Scenario files (TOML).

use std::path::Path;

use serde::Deserialize;
use toml::Spanned;
use torno_protocol::time::Span;

use super::part::{self, AsAsked, RawDiameter};
use super::{Action, PATIENCE, Scenario, Step};
use crate::condition::{RawCondition, replies};
use crate::fault::{Fault, RawFault, text_drawn};
use crate::rig::file::{DEFAULT, RigFile, RigFileError, built_in_names};
use crate::text_file::TextError;
use torno_bus::Names;
use torno_text::{Complaint, Dice, Invalid, nearest, span};

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
    rig: Option<Spanned<String>>,
    #[serde(default)]
    set: Vec<Spanned<String>>,
    #[serde(default)]
    seed: u64,
    held: Option<bool>,
    end: Option<Spanned<String>>,
    #[serde(default)]
    step: Vec<Spanned<RawStep>>,
    #[serde(default)]
    fault: Vec<RawFault>,
    #[serde(default)]
    expect: RawExpect,
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
    check: Option<RawCondition>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawExpect {
    replies: Option<Spanned<String>>,
    #[serde(default)]
    finally: Vec<RawCondition>,
    #[serde(default)]
    always: Vec<RawCondition>,
    #[serde(default)]
    never: Vec<RawCondition>,
    #[serde(default)]
    part: Vec<RawDiameter>,
}

impl Scenario {
    /// Reads a scenario file. A `seed` takes the place of the file's.
    ///
    /// # Errors
    /// [`ScenarioError`]: where, what was expected, what was found.
    pub fn load(path: &Path, seed: Option<u64>) -> Result<Self, ScenarioError> {
        let name = path.display().to_string();
        match crate::text_file::read(path) {
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
        let mut raw: RawScenario = toml::from_str(text).map_err(|error| invalid(torno_text::of_toml(&error)))?;
        raw.seed = seed.unwrap_or(raw.seed);
        let named = raw.rig.as_ref().map_or(DEFAULT, |rig| rig.get_ref());
        let beside = Path::new(path).parent().map(|folder| folder.join(named)).filter(|rig| rig.is_file());
        let rig = beside.map_or_else(|| named.to_owned(), |rig| rig.display().to_string());
        let mut file = RigFile::load(&rig).map_err(|error| match (error, &raw.rig) {
            (RigFileError::Unreadable { source, .. }, Some(rig)) => {
                invalid((rig.span(), no_rig(named, &source))).into()
            }
            (error, _) => ScenarioError::from(error),
        })?;
        for set in &raw.set {
            file = file.set(set.get_ref()).map_err(|message| invalid((set.span(), message)))?;
        }
        Ok(Self::check(raw, file, rig).map_err(invalid)?)
    }

    fn check(raw: RawScenario, file: RigFile, rig: String) -> Result<Self, Complaint> {
        let nothing = raw.step.is_empty() && raw.fault.is_empty() && raw.end.is_none();
        let names = file.names();
        let seed = raw.seed;
        let mut dice = Dice::new(seed);
        let mut known: Vec<Fault> = Vec::new();
        let mut faults = Vec::new();
        for raw in &raw.fault {
            let planned = raw.plan(&names, &mut dice)?;
            raw.check_name(&planned.fault, &known)?;
            known.push(planned.fault.clone());
            faults.push(planned);
        }
        let mut steps = Vec::new();
        let mut healed: Vec<String> = Vec::new();
        // What the frames ask for, up to a step.
        let mut sent: Vec<u8> = Vec::new();
        for (number, step) in raw.step.into_iter().enumerate() {
            let place = step.span();
            let step = step.into_inner();
            let as_asked = |within: &Spanned<String>| part::as_asked(&file, &sent, within);
            let action = step.check(&names, &known, number + 1, &mut dice, place.clone(), as_asked)?;
            if let (Some(_), Action::Send(bytes)) = (&step.send, &action) {
                sent.extend(bytes);
            }
            let raw_break = step.r#break.as_ref();
            match &action {
                Action::Break(fault) => {
                    let standing = known.iter().filter(|other| !healed.contains(&other.name));
                    raw_break.iter().try_for_each(|raw| raw.check_name(fault, standing.clone()))?;
                    healed.retain(|name| *name != fault.name);
                    known.push(fault.clone());
                }
                Action::Heal(name) if healed.contains(name) => {
                    let place = step.heal.as_ref().map_or(place, Spanned::span);
                    let message = format!("'{name}' has been healed before this step: expected something to break it");
                    return Err((place, message));
                }
                Action::Heal(name) => healed.push(name.clone()),
                _ => {}
            }
            steps.push(Step { does: step.does, action });
        }
        let (mut never_of_part, mut never) = (Vec::new(), Vec::new());
        for raw in &raw.expect.never {
            match raw.of_part()? {
                Some(event) => never_of_part.push(event),
                None => never.push(raw.check(&names)?),
            }
        }
        let checked = steps.iter().any(|step: &Step| matches!(step.action, Action::CheckPart(_)));
        let part = part::check(&file, &raw.expect.part, &never_of_part, checked)?;
        let claims = |raw: &[RawCondition]| raw.iter().map(|claim| claim.claim(&names)).collect::<Result<Vec<_>, _>>();
        let end = raw.end.as_ref().map_or(Ok(END), span)?;
        if let Some(raw) = raw.end.as_ref().filter(|_| end == Span::ZERO) {
            return Err((raw.span(), "end: nothing happens in no time: expected a time above 0".to_owned()));
        }
        let expected = raw.expect.replies.as_ref().map(|text| replies(text, names.dialect)).transpose()?;
        let (finally, always) = (claims(&raw.expect.finally)?, claims(&raw.expect.always)?);
        if nothing {
            return Err((0..0, "nothing is done and nothing breaks: expected a step, a fault, or an end".to_owned()));
        }
        Ok(Self {
            name: raw.name,
            rig,
            file,
            seed,
            drawn: dice.into_drawn(),
            held: raw.held.unwrap_or(names.dialect.holds_the_pc()),
            steps,
            faults,
            finally,
            always,
            replies: expected,
            never,
            part,
            end,
        })
    }
}

/// The complaint about a rig that cannot be read.
fn no_rig(name: &str, why: &std::io::Error) -> String {
    match why.kind() {
        std::io::ErrorKind::NotFound => {
            let nearest = nearest(name, &built_in_names());
            format!("there is no rig and no rig file '{name}'{nearest}")
        }
        _ => format!("cannot read the rig file '{name}': {why}"),
    }
}

impl RawStep {
    fn check(
        &self,
        names: &Names,
        known: &[Fault],
        number: usize,
        dice: &mut Dice,
        place: std::ops::Range<usize>,
        as_asked: impl Fn(&Spanned<String>) -> Result<AsAsked, Complaint>,
    ) -> Result<Action, Complaint> {
        let mut actions = Vec::new();
        if let Some(texts) = &self.send {
            let mut bytes = Vec::new();
            for text in texts {
                bytes.extend(names.dialect.bytes(text.get_ref()).map_err(|error| (text.span(), error))?);
            }
            if bytes.is_empty() {
                return Err((place, "send: expected something to send".to_owned()));
            }
            actions.push(Action::Send(bytes));
        }
        if let Some(text) = &self.bytes {
            let is_hex = |word: &&str| word.len() == 2 && word.bytes().all(|digit| digit.is_ascii_hexdigit());
            let byte = |word: &str| Some(word).filter(is_hex).and_then(|word| u8::from_str_radix(word, 16).ok());
            let bytes: Option<Vec<u8>> = text.get_ref().split_whitespace().map(byte).collect();
            let wrong = || (text.span(), "expected bytes of two hex digits".to_owned());
            actions.push(Action::Send(bytes.filter(|bytes| !bytes.is_empty()).ok_or_else(wrong)?));
        }
        if let Some(run) = &self.run {
            actions.push(Action::Run(span(&text_drawn(run, &format!("step.{number}.run"), dice)?)?));
        }
        if let Some(wait) = &self.wait {
            let (condition, within) = wait.awaited(names)?;
            actions.push(Action::Wait(condition, within.unwrap_or(PATIENCE)));
        }
        if let Some(fault) = &self.r#break {
            if let Some(place) = fault.says_when() {
                let message = "a step breaks something when its turn comes: expected neither at nor when here";
                return Err((place, message.to_owned()));
            }
            actions.push(Action::Break(fault.check(names, dice)?));
        }
        if let Some(name) = &self.heal {
            let Some(fault) = known.iter().rfind(|fault| fault.name == *name.get_ref()) else {
                let known: Vec<&str> = known.iter().map(|fault| fault.name.as_str()).collect();
                let message =
                    format!("there is no fault '{}' by now{}", name.get_ref(), nearest(name.get_ref(), &known));
                return Err((name.span(), message));
            };
            if fault.is_over_at_once() {
                let message = format!("'{}' is over at once: there is nothing to heal", fault.name);
                return Err((name.span(), message));
            }
            actions.push(Action::Heal(name.get_ref().clone()));
        }
        if let Some(claim) = &self.check {
            actions.push(match claim.of_whole_part()? {
                Some(within) => Action::CheckPart(as_asked(within)?),
                None => Action::Check(claim.claim(names)?),
            });
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
