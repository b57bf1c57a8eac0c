//! What is varied: a place in the scenario's file or its rig's, and the values that it takes.

use std::path::Path;

use toml::{Table, Value};
use xxhash_rust::xxh3::xxh3_128;

use crate::fault::Range;
use crate::rig::place;
use crate::scenario::{Scenario, ScenarioError};
use crate::text::{self, TextError, nearest};

/// A range has so many values at the most.
const VALUES_MAX: usize = 10_000;

/// Why something cannot be varied.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The variation is none.
    #[error("--vary '{text}': expected PLACE=FROM..TO, PLACE=FROM..TO/COUNT or PLACE=VALUE,VALUE…: {message}")]
    Variation {
        /// What was given.
        text: String,
        /// What is wrong.
        message: String,
    },
    /// There is no such place.
    #[error("--vary '{path}': {message}")]
    Place {
        /// The place.
        path: String,
        /// What is wrong.
        message: String,
    },
    /// The file cannot be read.
    #[error("{path}: cannot read the scenario")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        source: TextError,
    },
    /// What comes of it is no scenario.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
}

/// A place and its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variation {
    /// `fault.NAME.FIELD`, or a place in the rig: see [`place::set`].
    pub path: String,
    /// The values, as a file would have them.
    pub values: Vec<String>,
}

impl Variation {
    /// Reads `PLACE=FROM..TO/COUNT` (11 if not said; units at either end or both) or `PLACE=VALUE,VALUE…`.
    ///
    /// # Errors
    /// [`SweepError::Variation`].
    pub fn parse(text: &str) -> Result<Self, SweepError> {
        let wrong = |message: &str| SweepError::Variation { text: text.to_owned(), message: message.to_owned() };
        let (path, values) = text.split_once('=').ok_or_else(|| wrong("there is no '='"))?;
        let (path, values) = (path.trim().to_owned(), values.trim());
        let (range, count) = match values.split_once('/') {
            Some((range, count)) => (range, count.trim().parse().map_err(|_| wrong("COUNT is no number"))?),
            None => (values, 11),
        };
        let Some(range) = Range::parse(range) else {
            return Ok(Self { path, values: values.split(',').map(|value| value.trim().to_owned()).collect() });
        };
        let range = range.map_err(|message| wrong(&message))?;
        if !(2..=VALUES_MAX).contains(&count) {
            return Err(wrong("COUNT is not from 2 to 10000"));
        }
        let value = |n: usize| range.at(n as f64 / (count - 1) as f64);
        Ok(Self { path, values: (0..count).map(value).collect() })
    }
}

/// A scenario's text, in which and in whose rig values can be put.
#[derive(Clone, Debug)]
pub struct Scene {
    path: String,
    scenario: Table,
    /// What its rig's file says.
    rig: String,
}

impl Scene {
    /// Reads it.
    ///
    /// # Errors
    /// [`SweepError`] if the scenario as it stands is none.
    pub fn load(path: &Path) -> Result<Self, SweepError> {
        let name = path.display().to_string();
        let text = text::read(path).map_err(|source| SweepError::Unreadable { path: name.clone(), source })?;
        let rig = Scenario::parse(&name, &text, None)?.file.text;
        Ok(Self { path: name, scenario: toml::from_str(&text).unwrap_or_default(), rig })
    }

    /// A digest of what the scenario's file and its rig's say, wherever they are.
    pub fn digest(&self) -> String {
        let scenario = toml::to_string(&self.scenario).unwrap_or_default();
        format!("{:032x}", xxh3_128(format!("{}\n{scenario}{}", scenario.len(), self.rig).as_bytes()))
    }

    /// The faults' names, in the order of the file.
    pub fn faults(&self) -> Vec<String> {
        self.tables("fault").iter().map(|fault| fault_name(fault)).collect()
    }

    /// The scenario without these of its faults.
    pub fn without(&self, faults: &[String]) -> Self {
        let mut scene = self.clone();
        if let Some(Value::Array(all)) = scene.scenario.get_mut("fault") {
            all.retain(|fault| fault.as_table().is_none_or(|fault| !faults.contains(&fault_name(fault))));
        }
        scene
    }

    fn tables(&self, key: &str) -> Vec<&Table> {
        let array = self.scenario.get(key).and_then(Value::as_array);
        array.into_iter().flatten().filter_map(Value::as_table).collect()
    }

    /// The scenario with these values and this seed.
    ///
    /// # Errors
    /// [`SweepError`] if there is no such place, or the value does not fit it.
    pub fn with(&self, values: &[(String, String)], seed: u64) -> Result<Scenario, SweepError> {
        let wrong = |path: &str, message| SweepError::Place { path: path.to_owned(), message };
        let mut table = self.scenario.clone();
        let (of_faults, of_rig): (Vec<_>, Vec<_>) = values.iter().partition(|(path, _)| path.starts_with("fault."));
        for (path, value) in of_faults {
            set_fault(&mut table, path, value).map_err(|message| wrong(path, message))?;
        }
        let text = toml::to_string(&table).unwrap_or_default();
        let mut scenario = Scenario::parse(&self.path, &text, Some(seed))?;
        for (path, value) in of_rig {
            scenario.file = scenario.file.with(path, value).map_err(|message| wrong(path, message))?;
        }
        Ok(scenario)
    }
}

/// Puts `value` at `fault.NAME.FIELD` of a scenario.
fn set_fault(scenario: &mut Table, path: &str, value: &str) -> Result<(), String> {
    let words: Vec<&str> = path.split('.').collect();
    let ["fault", name, field @ ..] = &words[..] else { return Err("expected fault.NAME.FIELD".to_owned()) };
    let all = scenario.get_mut("fault").and_then(Value::as_array_mut).ok_or("there is no fault")?;
    let known: Vec<String> = all.iter().filter_map(Value::as_table).map(fault_name).collect();
    let found = known.iter().position(|other| other == name).ok_or_else(|| {
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        format!("there is no fault '{name}'{}", nearest(name, &known))
    })?;
    let fault = all[found].as_table_mut().ok_or("no table")?;
    *place::entry(fault, field)? = place::parsed(value);
    Ok(())
}

fn text_of(table: &Table, key: &str) -> String {
    table.get(key).and_then(Value::as_str).unwrap_or_default().to_owned()
}

/// As the fault's own file has it: its name, or its place and kind.
fn fault_name(fault: &Table) -> String {
    match text_of(fault, "name") {
        name if !name.is_empty() => name,
        _ => format!("{}{} {}", text_of(fault, "line"), text_of(fault, "board"), text_of(fault, "kind")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Vec<String> {
        Variation::parse(text).unwrap().values
    }

    #[test]
    fn a_variation_is_a_range_or_a_list() {
        assert_eq!(values("a.b=0..1/3"), ["0", "0.5", "1"]);
        assert_eq!(values("a=-2..2%/5"), ["-2 %", "-1 %", "0 %", "1 %", "2 %"]);
        assert_eq!(values("a=1 ms..3 ms/3"), ["1 ms", "2 ms", "3 ms"]);
        assert_eq!(values("a=1,2,7"), ["1", "2", "7"]);
        assert_eq!(values("a=0..10").len(), 11);
        for wrong in ["a", "a=..", "a=1..x", "a=1..2/1", "a=1..2/x", "a=1 s..2 ms"] {
            assert!(Variation::parse(wrong).is_err(), "{wrong}");
        }
    }
}
