//! Scenario files (TOML).

use std::path::Path;

use serde::Deserialize;
use toml::Spanned;
use torno_protocol::time::Span;

use super::part::{self, RawDiameter};
use super::{Action, PATIENCE, Scenario, Step};
use crate::condition::{RawClaim, RawCondition, words};
use crate::fault::{Dice, Fault, RawFault, span, text_drawn};
use crate::rig::file::{RigFile, RigFileError};
use crate::rig::names::Names;
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
    held: Option<bool>,
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
        let mut raw: RawScenario = toml::from_str(text).map_err(|error| invalid(text::of_toml(&error)))?;
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
        let mut dice = Dice::new(seed);
        let mut known: Vec<Fault> = Vec::new();
        let mut faults = Vec::new();
        for raw in &raw.fault {
            let planned = raw.plan(&names, &mut dice)?;
            raw.bear_its_own_name(&planned.fault, &known)?;
            known.push(planned.fault.clone());
            faults.push(planned);
        }
        let mut steps = Vec::new();
        let mut healed: Vec<String> = Vec::new();
        for (number, step) in raw.step.into_iter().enumerate() {
            let place = step.span();
            let step = step.into_inner();
            let action = step.check(&names, &known, number + 1, &mut dice, place)?;
            let raw_break = step.r#break.as_ref();
            match &action {
                Action::Break(fault) => {
                    let standing = known.iter().filter(|other| !healed.contains(&other.name));
                    raw_break.iter().try_for_each(|raw| raw.bear_its_own_name(fault, standing.clone()))?;
                    healed.retain(|name| *name != fault.name);
                    known.push(fault.clone());
                }
                Action::Heal(name) => healed.push(name.clone()),
                _ => {}
            }
            steps.push(Step { does: step.does, action });
        }
        let (never_of_part, never): (Vec<_>, Vec<_>) =
            raw.expect.never.iter().partition(|never| never.of_part().is_some());
        let never_of_part: Vec<_> = never_of_part.into_iter().filter_map(RawCondition::of_part).collect();
        let part = part::check(&file, &raw.expect.part, &never_of_part)?;
        let claims = |raw: &[RawClaim]| raw.iter().map(|claim| claim.check(&names)).collect::<Result<Vec<_>, _>>();
        Ok(Self {
            name: raw.name,
            rig,
            file,
            seed,
            drawn: dice.into_drawn(),
            held: raw.held.unwrap_or(names.dialect.holds_the_pc()),
            steps,
            faults,
            finally: claims(&raw.expect.finally)?,
            always: claims(&raw.expect.always)?,
            replies: raw.expect.replies.as_deref().map(words),
            never: never.iter().map(|never| never.check(&names)).collect::<Result<_, _>>()?,
            part,
            end: raw.end.as_ref().map_or(Ok(END), span)?,
        })
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
    ) -> Result<Action, Complaint> {
        let mut actions = Vec::new();
        if let Some(texts) = &self.send {
            let mut bytes = Vec::new();
            for text in texts {
                bytes.extend(names.dialect.bytes(text.get_ref()).map_err(|error| (text.span(), error))?);
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
            actions.push(Action::Run(span(&text_drawn(run, &format!("step.{number}.run"), dice)?)?));
        }
        if let Some(wait) = &self.wait {
            actions.push(Action::Wait(wait.check(names)?, wait.within.as_ref().map_or(Ok(PATIENCE), span)?));
        }
        if let Some(fault) = &self.r#break {
            if let Some(place) = fault.says_when() {
                return Err((place, "a step breaks something when its turn comes: expected no at here".to_owned()));
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
