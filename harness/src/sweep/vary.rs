//! What is varied: a place in the scenario's file or its rig's, and the values that it takes.

use std::path::Path;

use toml::{Table, Value};
use xxhash_rust::xxh3::xxh3_128;

use super::RUNS_MAX;
use crate::fault::LINE_KINDS;
use crate::rig::place;
use crate::scenario::{Scenario, ScenarioError};
use crate::text_file::TextError;
use torno_text::{Invalid, Range, nearest};

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
    /// There is too much to do.
    #[error(
        "--vary and --seeds make {runs} runs, and one command does at most {RUNS_MAX}: expected fewer, \
         or --shard I/{of} to do one part of {of}"
    )]
    Many {
        /// So many runs.
        runs: u128,
        /// In so many parts, each is one that a command does.
        of: u128,
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
    /// `fault.NAME.FIELD`; `line.LINE.KIND`, the value of such a fault on a line; or a place in the rig: see
    /// [`place::set`].
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
    /// The lines of its rig.
    lines: Vec<String>,
    /// Faults that are left out.
    without: Vec<String>,
}

impl Scene {
    /// Reads it.
    ///
    /// # Errors
    /// [`SweepError`] if the scenario as it stands is none.
    pub fn load(path: &Path) -> Result<Self, SweepError> {
        let name = path.display().to_string();
        let text =
            crate::text_file::read(path).map_err(|source| SweepError::Unreadable { path: name.clone(), source })?;
        let file = Scenario::parse(&name, &text, None)?.file;
        let scenario = toml::from_str(&text).unwrap_or_default();
        Ok(Self { path: name, scenario, lines: file.names().lines, rig: file.text, without: Vec::new() })
    }

    /// A digest of what the scenario's file and its rig's say, wherever they are.
    pub fn digest(&self) -> String {
        let scenario = toml::to_string(&self.scenario).unwrap_or_default();
        format!("{:032x}", xxh3_128(format!("{}\n{scenario}{}", scenario.len(), self.rig).as_bytes()))
    }

    /// The faults' names, in the order of the file; and of those that come with `values`.
    pub fn faults(&self, values: &[(String, String)]) -> Vec<String> {
        let tables = self.scenario.get("fault").and_then(Value::as_array).into_iter().flatten();
        let mut names: Vec<String> = tables.filter_map(Value::as_table).map(fault_name).collect();
        for fault in values.iter().filter_map(|(path, _)| self.fault_of(path)) {
            if !names.contains(&fault) {
                names.push(fault);
            }
        }
        names
    }

    /// The fault that a place belongs to, if it belongs to one.
    fn fault_of(&self, path: &str) -> Option<String> {
        match &path.split('.').collect::<Vec<_>>()[..] {
            ["fault", name, ..] => Some((*name).to_owned()),
            ["line", line, kind] => Some(self.fault_on(line, kind).map_or(format!("{line} {kind}"), fault_name)),
            _ => None,
        }
    }

    /// The first fault of that kind on that line.
    fn fault_on(&self, line: &str, kind: &str) -> Option<&Table> {
        let faults = self.scenario.get("fault").and_then(Value::as_array).into_iter().flatten();
        let is = |fault: &&Table| text_of(fault, "line") == line && text_of(fault, "kind") == kind;
        faults.filter_map(Value::as_table).find(is)
    }

    /// The scenario without these faults, and without what is said of them.
    pub fn without(&self, faults: &[String]) -> Self {
        Self { without: [&self.without, faults].concat(), ..self.clone() }
    }

    /// Leaves out what is to be left out.
    fn leave_out(&mut self) {
        if let Some(Value::Array(all)) = self.scenario.get_mut("fault") {
            all.retain(|fault| fault.as_table().is_none_or(|fault| !self.without.contains(&fault_name(fault))));
        }
        for name in &self.without {
            let steps = self.scenario.get_mut("step").and_then(Value::as_array_mut).into_iter().flatten();
            // Another one of this name may be broken by a step after that.
            let mut heals = steps.filter_map(Value::as_table_mut).filter(|step| text_of(step, "heal") == *name);
            if let Some(step) = heals.next() {
                // The steps after it keep their numbers, by which they draw.
                step.remove("heal");
                step.insert("run".to_owned(), Value::from("0 s"));
            }
        }
    }

    /// The scenario with these values and this seed.
    ///
    /// # Errors
    /// [`SweepError`] if there is no such place, or the value does not fit it.
    pub fn with(&self, values: &[(String, String)], seed: u64) -> Result<Scenario, SweepError> {
        let mut scene = self.clone();
        let mut of_rig = Vec::new();
        for (path, value) in values {
            if self.fault_of(path).is_some_and(|fault| self.without.contains(&fault)) {
                continue;
            }
            let put = match &path.split('.').collect::<Vec<_>>()[..] {
                ["fault", name, field @ ..] => set_fault(&mut scene.scenario, name, field, value),
                ["line", line, kind] => scene.set_line(line, kind, value),
                ["line", ..] => Err("expected line.LINE.KIND, such as line.pc_to_master.noise".to_owned()),
                _ => {
                    of_rig.push((path, value));
                    Ok(())
                }
            };
            put.map_err(|message| SweepError::Place { path: path.clone(), message })?;
        }
        scene.leave_out();
        let text = toml::to_string(&scene.scenario).unwrap_or_default();
        // No one has the text that this makes before him: what is wrong is what has been put into it.
        let mut scenario = Scenario::parse(&self.path, &text, Some(seed)).map_err(|error| match error {
            ScenarioError::Invalid(Invalid { message, .. }) if !values.is_empty() => {
                let said: Vec<String> = values.iter().map(|(path, value)| format!("{path} = {value}")).collect();
                SweepError::Place { path: said.join(", "), message }
            }
            error => error.into(),
        })?;
        for (path, value) in of_rig {
            let wrong = |message| SweepError::Place { path: path.clone(), message };
            scenario.file = scenario.file.with(path, value).map_err(wrong)?;
        }
        Ok(scenario)
    }

    /// Puts `value` into the fault of this kind on a line. If there is none, one comes to be: from the start on, and
    /// noise until the last step is done, if one waits or runs.
    fn set_line(&mut self, line: &str, kind: &str, value: &str) -> Result<(), String> {
        let lines: Vec<&str> = self.lines.iter().map(String::as_str).collect();
        if !lines.contains(&line) {
            return Err(format!("there is no line '{line}'{}", nearest(line, &lines)));
        }
        if !LINE_KINDS.contains(&kind) {
            return Err(format!("there is no fault '{kind}' of a line{}", nearest(kind, &LINE_KINDS)));
        }
        if let Some(name) = self.fault_on(line, kind).map(fault_name) {
            return set_fault(&mut self.scenario, &name, &["value"], value);
        }
        let text = |text: &str| Value::from(text);
        let fault = [("line", text(line)), ("kind", text(kind)), ("value", place::parsed(value))];
        append(&mut self.scenario, "fault", table(fault))?;
        let mut steps = self.scenario.get("step").and_then(Value::as_array).into_iter().flatten();
        // Steps that take no time would be done before anything has happened.
        if kind == "noise" && steps.any(|step| step.get("wait").or(step.get("run")).is_some()) {
            let heal = [("does", text("the noise ends")), ("heal", Value::from(format!("{line} {kind}")))];
            append(&mut self.scenario, "step", table(heal))?;
        }
        Ok(())
    }
}

fn table<const N: usize>(fields: [(&str, Value); N]) -> Value {
    Value::Table(fields.into_iter().map(|(field, value)| (field.to_owned(), value)).collect())
}

fn append(scenario: &mut Table, key: &str, value: Value) -> Result<(), String> {
    let all = scenario.entry(key).or_insert_with(|| Value::Array(Vec::new()));
    all.as_array_mut().ok_or_else(|| format!("'{key}' is no array"))?.push(value);
    Ok(())
}

/// Puts `value` into the `field` of a fault.
fn set_fault(scenario: &mut Table, name: &str, field: &[&str], value: &str) -> Result<(), String> {
    let fault = fault_named(scenario, name)?;
    // Noise says how much of it there is in one of two ways.
    match field {
        ["value"] => drop(fault.remove("period")),
        ["period"] => drop(fault.remove("value")),
        _ => {}
    }
    *place::entry(fault, field)? = place::parsed(value);
    Ok(())
}

fn fault_named<'a>(scenario: &'a mut Table, name: &str) -> Result<&'a mut Table, String> {
    let all = scenario.get_mut("fault").and_then(Value::as_array_mut).ok_or("there is no fault")?;
    let known: Vec<String> = all.iter().filter_map(Value::as_table).map(fault_name).collect();
    let found = known.iter().position(|other| other == name).ok_or_else(|| {
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        format!("there is no fault '{name}'{}", nearest(name, &known))
    })?;
    all[found].as_table_mut().ok_or_else(|| "a fault is no table".to_owned())
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
        assert_eq!(values("a=500 us..1.5 ms/3"), ["0.5 ms", "1 ms", "1.5 ms"]);
        assert_eq!(values("a=1,2,7"), ["1", "2", "7"]);
        assert_eq!(values("a=0..10").len(), 11);
        for wrong in ["a", "a=..", "a=1..x", "a=1..2/1", "a=1..2/x", "a=1 s..2 ms", "a=1 s..2 %", "a=3..1"] {
            assert!(Variation::parse(wrong).is_err(), "{wrong}");
        }
    }
}
